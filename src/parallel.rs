//! Loops whose iterations run in parallel, in the rayon pool they are called from.
//!
//! All of them go through one function, [`spread`], so that rayon's code is compiled once, and not once for each loop. That is why the work
//! is a `&dyn Fn`: a type of its own for each closure would compile that code anew. What is called so does a row, a block of values or
//! another large piece of work, so that the call costs nothing; pixels are the caller's own loop inside of it.
//!
//! The order in which iterations run depends on the threads, and no result does: each iteration writes its own part, and results are in
//! the order of the indices.

use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Values of a block of [`for_each_block`].
const BLOCK: usize = 4096;

/// Calls `act(number, item)` for each of `items`, which are numbered from 0.
pub(crate) fn for_each<I: Send>(items: impl Iterator<Item = I>, act: &(dyn Fn(usize, I) + Sync)) {
    for_each_with(items, &|| (), &|(), number, item| act(number, item));
}

/// Calls `act(y, row)` for each row of `width` of the `values`; the last one may be shorter. Without a width, each value is a row.
pub(crate) fn for_each_row<T: Send>(values: &mut [T], width: usize, act: &(dyn Fn(usize, &mut [T]) + Sync)) {
    for_each(values.chunks_mut(width.max(1)), act);
}

/// Calls `act(y, rows)` with row `y`, of `width` values, of each of `planes`, which have the same number of values.
pub(crate) fn for_each_row_of<const N: usize>(
    planes: [&mut [f32]; N],
    width: usize,
    act: &(dyn Fn(usize, [&mut [f32]; N]) + Sync),
) {
    for_each(rows_of(planes, width).into_iter(), act);
}

/// Calls `act(range, values)` for each block of the `values`, which are those of the `range`: for loops over values that have no rows.
pub(crate) fn for_each_block<T: Send>(values: &mut [T], act: &(dyn Fn(Range<usize>, &mut [T]) + Sync)) {
    for_each_row(values, BLOCK, &|block, values| {
        act(block * BLOCK..block * BLOCK + values.len(), values);
    });
}

/// [`for_each`] with scratch memory: `act(scratch, number, item)`. `scratch` makes it for a number of adjacent items.
pub(crate) fn for_each_with<I: Send, S>(
    items: impl Iterator<Item = I>,
    scratch: &(dyn Fn() -> S + Sync),
    act: &(dyn Fn(&mut S, usize, I) + Sync),
) {
    for_each_in_tasks(usize::MAX, items, scratch, act);
}

/// [`for_each_with`], where a thread takes at most `most` items at a time.
pub(crate) fn for_each_in_tasks<I: Send, S>(
    most: usize,
    items: impl Iterator<Item = I>,
    scratch: &(dyn Fn() -> S + Sync),
    act: &(dyn Fn(&mut S, usize, I) + Sync),
) {
    let slots: Slots<I> = items.map(Slot::holding).collect();
    spread(slots.len(), most, &|| {
        let (mut scratch, slots) = (scratch(), &slots);
        Box::new(move |number| {
            if let Some(item) = slots[number].take() {
                act(&mut scratch, number, item);
            }
        })
    });
}

/// `of(index)` for each index below `count`, in their order. Each result has a lock of its own, which costs nothing beside a row, and too
/// much beside a pixel.
pub(crate) fn map<T: Send>(count: usize, of: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    map_with(count, &|| (), &|(), index| of(index))
}

/// [`map`] with scratch memory: `of(scratch, index)`. `scratch` makes it for a number of adjacent indices.
pub(crate) fn map_with<T: Send, S>(
    count: usize,
    scratch: &(dyn Fn() -> S + Sync),
    of: &(dyn Fn(&mut S, usize) -> T + Sync),
) -> Vec<T> {
    let slots = empty(count);
    spread(count, usize::MAX, &|| {
        let (mut scratch, slots) = (scratch(), &slots);
        Box::new(move |index| slots[index].put(of(&mut scratch, index)))
    });
    results(slots)
}

/// `of(number, item)` for each of `items`, in their order, as [`map`] has it.
pub(crate) fn map_each<I: Send, T: Send>(
    items: impl Iterator<Item = I>,
    of: &(dyn Fn(usize, I) -> T + Sync),
) -> Vec<T> {
    let items: Vec<I> = items.collect();
    let slots = empty(items.len());
    for_each(items.into_iter().zip(&slots), &|number, (item, slot)| slot.put(of(number, item)));
    results(slots)
}

/// `of(index)` for each index below `count`, in their order, where that takes too little time for [`map`]: some adjacent indices have one
/// call and one lock together. For a while the results take their memory twice.
pub(crate) fn map_in_blocks<T: Send>(count: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    /// Few enough that there is work for all threads.
    const TOGETHER: usize = 256;
    flat_map(count.div_ceil(TOGETHER), &|block| {
        (block * TOGETHER..((block + 1) * TOGETHER).min(count)).map(&of).collect()
    })
}

/// The values of all lists `of(index)`, in the order of the indices below `count`.
pub(crate) fn flat_map<T: Send>(count: usize, of: &(dyn Fn(usize) -> Vec<T> + Sync)) -> Vec<T> {
    let lists = map(count, of);
    let mut values = Vec::with_capacity(lists.iter().map(Vec::len).sum());
    lists.into_iter().for_each(|list| values.extend(list));
    values
}

/// Whether `holds(index)` for all indices below `count`. It is not asked of all of them once it is known not to.
pub(crate) fn all(count: usize, holds: &(dyn Fn(usize) -> bool + Sync)) -> bool {
    let fails = AtomicBool::new(false);
    for_each(0..count, &|_, index| {
        if !fails.load(Ordering::Relaxed) && !holds(index) {
            fails.store(true, Ordering::Relaxed);
        }
    });
    !fails.into_inner()
}

/// For each row of `width` values, those of each of `planes`.
fn rows_of<const N: usize>(planes: [&mut [f32]; N], width: usize) -> Vec<[&mut [f32]; N]> {
    let count = planes.iter().map(|plane| plane.len().div_ceil(width.max(1))).min().unwrap_or(0);
    let mut rows = planes.map(|plane| plane.chunks_mut(width.max(1)));
    (0..count).map(|_| rows.each_mut().map(|rows| rows.next().unwrap_or_default())).collect()
}

/// What works on some adjacent indices, one after another.
type Worker<'a> = Box<dyn FnMut(usize) + 'a>;

/// Calls a worker with each index below `count`; each has at most `most` of them.
fn spread<'a>(count: usize, most: usize, worker: &'a (dyn Fn() -> Worker<'a> + Sync)) {
    (0..count).into_par_iter().with_max_len(most).for_each_init(worker, |worker, index| worker(index));
}

/// An item until it is taken, or a result once it is there. It is never locked for longer.
struct Slot<T>(Mutex<Option<T>>);

type Slots<T> = Vec<Slot<T>>;

impl<T> Slot<T> {
    fn holding(item: T) -> Self {
        Self(Mutex::new(Some(item)))
    }

    fn take(&self) -> Option<T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn put(&self, item: T) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(item);
    }
}

fn empty<T>(count: usize) -> Slots<T> {
    (0..count).map(|_| Slot(Mutex::new(None))).collect()
}

fn results<T>(slots: Slots<T>) -> Vec<T> {
    let mut results = Vec::with_capacity(slots.len());
    results.extend(
        slots.into_iter().filter_map(|slot| slot.0.into_inner().unwrap_or_else(PoisonError::into_inner)),
    );
    results
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    #[test]
    fn every_item_has_its_turn_once() {
        for count in [0, 1, 1000] {
            let turns: Vec<AtomicUsize> = (0..count).map(|_| AtomicUsize::new(0)).collect();
            for_each(turns.iter(), &|_, turns| {
                turns.fetch_add(1, Ordering::Relaxed);
            });
            assert!(turns.iter().all(|turns| turns.load(Ordering::Relaxed) == 1), "{count}");
        }
    }

    #[test]
    fn items_come_with_their_numbers() {
        let mut numbers = vec![0; 100];
        for_each(numbers.iter_mut().zip(1000..), &|number, (to, item)| *to = number + item);
        assert_eq!(numbers, (0..100).map(|number| 1000 + 2 * number).collect::<Vec<_>>());
    }

    /// For each of 7 values in rows of `width`, the number and the length of its row.
    fn rows(width: usize) -> Vec<[usize; 2]> {
        let mut values = vec![[0; 2]; 7];
        for_each_row(&mut values, width, &|y, row| row.fill([y, row.len()]));
        values
    }

    #[test]
    fn rows_come_with_their_numbers_and_the_last_one_may_be_shorter() {
        assert_eq!(rows(3), [[0, 3], [0, 3], [0, 3], [1, 3], [1, 3], [1, 3], [2, 1]]);
    }

    #[test]
    fn without_a_width_each_value_is_a_row_and_without_values_there_is_none() {
        assert_eq!(rows(0), [0, 1, 2, 3, 4, 5, 6].map(|y| [y, 1]));
        for_each_row::<f32>(&mut [], 0, &|_, _| panic!("there is no row"));
    }

    #[test]
    fn planes_give_the_same_row_at_once() {
        let [mut a, mut b] = [[0.0; 6], [0.0; 6]];
        for_each_row_of([&mut a, &mut b], 2, &|y, [a, b]| {
            a.fill(y as f32);
            b.fill(10.0 + y as f32);
        });
        assert_eq!((a, b), ([0.0, 0.0, 1.0, 1.0, 2.0, 2.0], [10.0, 10.0, 11.0, 11.0, 12.0, 12.0]));
        for_each_row_of([&mut [], &mut []], 0, &|_, _| panic!("there is no row"));
    }

    #[test]
    fn blocks_come_with_the_range_of_their_values() {
        for count in [0, 1, BLOCK, 2 * BLOCK + 3] {
            let mut values = vec![0; count];
            for_each_block(&mut values, &|range, values| {
                assert_eq!(range.len(), values.len());
                values.iter_mut().zip(range).for_each(|(value, index)| *value = index);
            });
            assert!(values.into_iter().eq(0..count), "{count}");
        }
    }

    #[test]
    fn scratch_memory_serves_no_more_items_than_a_task_has() {
        let most_served = AtomicUsize::new(0);
        let mut numbers = vec![0; 1000];
        // One thread, which would take many at a time.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        pool.install(|| {
            for_each_in_tasks(8, numbers.iter_mut(), &|| 0, &|served, number, to| {
                *served += 1;
                most_served.fetch_max(*served, Ordering::Relaxed);
                *to = number;
            });
        });
        assert!(numbers.into_iter().eq(0..1000));
        assert!(most_served.into_inner() <= 8);
    }

    #[test]
    fn results_are_in_the_order_of_the_indices() {
        for count in [0, 1, 1000] {
            assert!(map(count, &|index| index.to_string()).into_iter().eq((0..count).map(|i| i.to_string())));
            let squares = map_with(count, &Vec::new, &|scratch, index| {
                scratch.push(index);
                index * index
            });
            assert!(squares.into_iter().eq((0..count).map(|index| index * index)));
            let numbers = map_each((0..count).rev(), &|number, item| [number, item]);
            assert!(numbers.into_iter().eq((0..count).map(|index| [index, count - 1 - index])));
            assert!(map_in_blocks(count, |index| index + 1).into_iter().eq(1..=count));
            let lists = flat_map(count, &|index| vec![index; index % 3]);
            assert!(lists.into_iter().eq((0..count).flat_map(|index| vec![index; index % 3])));
        }
    }

    #[test]
    fn something_holds_for_all_unless_one_fails() {
        assert!(all(0, &|_| false) && all(1000, &|_| true));
        assert!(!all(1000, &|index| index != 700));
    }

    #[test]
    fn nothing_is_asked_that_cannot_change_the_answer() {
        let asked = AtomicUsize::new(0);
        let fails = |_| {
            asked.fetch_add(1, Ordering::Relaxed);
            false
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert!(!pool.install(|| all(1000, &fails)));
        assert_eq!(asked.into_inner(), 1);
    }

    #[test]
    fn a_panic_of_the_work_reaches_the_caller() {
        let caught = std::panic::catch_unwind(|| map(100, &|index| assert_ne!(index, 70, "the seventieth")));
        let message = caught.unwrap_err();
        assert!(message.downcast_ref::<String>().is_some_and(|text| text.contains("the seventieth")));
    }
}
