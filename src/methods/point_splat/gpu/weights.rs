//! Weights of the sprites that some points have, in one table.

use super::super::splat::Point;
use super::super::sprites::{Border, Centre, Place, Sprite, Sprites};
use rayon::prelude::*;

/// A point inside of the picture.
const INNER: Border = Border { left: false, right: false };

/// A sprite about one of the two centres. One in front of focus is the one as far behind it, turned by 180°.
#[derive(Debug, Clone, Copy)]
struct Shape {
    sprite: Sprite,
    centre: Centre,
}

impl Shape {
    /// Its number among all.
    fn number<const N: usize>(point: &Point<N>, centre: Centre) -> usize {
        usize::from(point.sprite.0 & !1) + usize::from(centre == Centre::Corner)
    }

    fn numbered(number: usize) -> Self {
        let centre = if number % 2 == 1 { Centre::Corner } else { Centre::Pixel };
        Self { sprite: Sprite((number & !1) as u16), centre }
    }

    /// How far its weights go across and down in a picture of this size: past it, repetitions tell nothing new.
    fn reach(self, (width, height): (usize, usize)) -> [usize; 2] {
        let reach = self.sprite.reach() as usize;
        [reach.min(width), (reach + usize::from(self.centre == Centre::Corner)).min(height)]
    }

    /// Number of its weights.
    fn count(self, size: (usize, usize)) -> usize {
        let [across, down] = self.reach(size);
        (2 * across + 2) * (2 * down + 2)
    }

    /// Which of them is the one of its own pixel.
    fn own(self, size: (usize, usize)) -> usize {
        let [across, down] = self.reach(size);
        (2 * across + 2) * down + across
    }

    /// Its weights, row by row; as many about the corner of four pixels to either side.
    fn weights(self, sprites: &Sprites, size: (usize, usize)) -> Vec<f32> {
        let [_, down] = self.reach(size).map(|reach| reach as i32);
        let (mut row, mut weights) = (Vec::new(), Vec::with_capacity(self.count(size)));
        for down in -down..=down + 1 {
            let place = Place { centre: self.centre, down, border: INNER };
            sprites.row(self.sprite, &place, size.0 as i32, &mut row);
            weights.extend_from_slice(&row);
        }
        weights
    }
}

/// Where the weights of all shapes lie that some points have.
#[derive(Debug)]
pub(super) struct Table {
    size: (usize, usize),
    /// Index of the first weight, by number; meaningless for those that no point has.
    firsts: Vec<usize>,
    has: Vec<bool>,
    /// Number of all weights.
    pub count: usize,
}

impl Table {
    /// The table for `points` of a picture of this size.
    pub(super) fn new<'a, const N: usize>(
        points: impl Iterator<Item = (&'a Point<N>, Centre)>,
        size: (usize, usize),
    ) -> Self {
        let mut has: Vec<bool> = Vec::new();
        for (point, centre) in points {
            let number = Shape::number(point, centre);
            if number >= has.len() {
                has.resize(number + 1, false);
            }
            has[number] = true;
        }
        let mut count = 0;
        let begin = |(number, &has): (usize, &bool)| {
            let first = count;
            count += if has { Shape::numbered(number).count(size) } else { 0 };
            first
        };
        let firsts = has.iter().enumerate().map(begin).collect();
        Self { size, firsts, has, count }
    }

    /// Index of the weight of the point's own pixel.
    pub(super) fn own<const N: usize>(&self, point: &Point<N>, centre: Centre) -> u32 {
        let number = Shape::number(point, centre);
        (self.firsts[number] + Shape::numbered(number).own(self.size)) as u32
    }

    /// All weights.
    pub(super) fn weights(&self, sprites: &Sprites) -> Vec<f32> {
        let numbers: Vec<usize> = (0..self.has.len()).filter(|&number| self.has[number]).collect();
        let weights = |number| Shape::numbered(number).weights(sprites, self.size);
        numbers.into_par_iter().flat_map_iter(weights).collect()
    }
}
