//! Weights of all sprites in use, in one table.

use super::super::splat::Point;
use super::super::sprites::{Border, Centre, Place, Sprite, Sprites};
use crate::parallel;

/// Border of a point inside of the picture.
const INNER: Border = Border { left: false, right: false };

/// A sprite about one of the two centres. In front of focus it is the sprite of the same radius behind focus, turned
/// by 180°.
#[derive(Debug, Clone, Copy)]
struct Shape {
    sprite: Sprite,
    centre: Centre,
}

impl Shape {
    /// Its index among all shapes.
    fn index<const N: usize>(point: &Point<N>, centre: Centre) -> usize {
        usize::from(point.sprite.0 & !1) + usize::from(centre == Centre::Corner)
    }

    fn from_index(index: usize) -> Self {
        let centre = if index % 2 == 1 { Centre::Corner } else { Centre::Pixel };
        Self { sprite: Sprite((index & !1) as u16), centre }
    }

    /// Reach of its weights across and down in a picture of this size: beyond that, repetitions add no new term.
    fn reach(self, (width, height): (usize, usize)) -> [usize; 2] {
        let reach = self.sprite.reach() as usize;
        [reach.min(width), (reach + usize::from(self.centre == Centre::Corner)).min(height)]
    }

    /// Number of its weights.
    fn count(self, size: (usize, usize)) -> usize {
        let [across, down] = self.reach(size);
        (2 * across + 2) * (2 * down + 2)
    }

    /// Index of the weight of its own pixel.
    fn centre_index(self, size: (usize, usize)) -> usize {
        let [across, down] = self.reach(size);
        (2 * across + 2) * down + across
    }

    /// Its weights, row by row. About a corner there are as many rows on either side.
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

/// Positions of the weights of all shapes in use.
#[derive(Debug)]
pub(super) struct WeightTable {
    size: (usize, usize),
    /// Index of the first weight, by shape index; meaningless for shapes not in use.
    firsts: Vec<usize>,
    in_use: Vec<bool>,
    /// Number of all weights.
    pub count: usize,
}

impl WeightTable {
    /// The table for `points` of a picture of this size.
    pub(super) fn new<'a, const N: usize>(
        points: impl Iterator<Item = (&'a Point<N>, Centre)>,
        size: (usize, usize),
    ) -> Self {
        let mut in_use: Vec<bool> = Vec::new();
        for (point, centre) in points {
            let index = Shape::index(point, centre);
            if index >= in_use.len() {
                in_use.resize(index + 1, false);
            }
            in_use[index] = true;
        }
        let mut count = 0;
        let begin = |(index, &in_use): (usize, &bool)| {
            let first = count;
            count += if in_use { Shape::from_index(index).count(size) } else { 0 };
            first
        };
        let firsts = in_use.iter().enumerate().map(begin).collect();
        Self { size, firsts, in_use, count }
    }

    /// Index of the weight of the point's own pixel.
    pub(super) fn centre_index<const N: usize>(&self, point: &Point<N>, centre: Centre) -> u32 {
        let index = Shape::index(point, centre);
        (self.firsts[index] + Shape::from_index(index).centre_index(self.size)) as u32
    }

    /// All weights.
    pub(super) fn weights(&self, sprites: &Sprites) -> Vec<f32> {
        let indices: Vec<usize> = (0..self.in_use.len()).filter(|&index| self.in_use[index]).collect();
        let weights = |number: usize| Shape::from_index(indices[number]).weights(sprites, self.size);
        parallel::flat_map(indices.len(), &weights)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::layers::Light;
    use super::*;
    use crate::lens::Aperture;

    fn point(coc_px: f32) -> Point<1> {
        let light = Light { content: [1.0], alpha: 1.0, coc_px, hidden: false };
        Point { column: 0, sprite: Sprite::from_coc_px(coc_px), light }
    }

    #[test]
    fn a_table_has_the_rows_of_every_sprite_that_points_have_and_no_others() {
        let sprites = Sprites::new(Aperture::new(5, 20.0).unwrap(), &[1.0, 0.5]);
        let points =
            [(point(3.0), Centre::Pixel), (point(-3.0), Centre::Pixel), (point(5.0), Centre::Corner)];
        let table = WeightTable::new(points.iter().map(|(point, centre)| (point, *centre)), (40, 30));
        let weights = table.weights(&sprites);
        // Squares of 4 and 6 pixels around the centre, plus a row and a column each, and one more row for the corner.
        assert_eq!((table.count, weights.len()), (10 * 10 + 14 * 16, 324));
        let total: f32 = weights.iter().sum();
        assert!((total - 2.0).abs() < 1e-3, "a sprite of either kind: {total}");
        let mut row = Vec::new();
        for (point, centre) in &points[1..] {
            let behind = Sprite(point.sprite.0 & !1);
            let place = Place { centre: *centre, down: -2, border: INNER };
            let first = sprites.row(behind, &place, 40, &mut row);
            let start = table.centre_index(point, *centre) as i32 - 2 * row.len() as i32 + first;
            assert_eq!(weights[start as usize..][..row.len()], row, "{centre:?}");
        }
    }

    #[test]
    fn a_sprite_in_front_of_focus_is_the_one_behind_it_turned() {
        let sprites = Sprites::new(Aperture::new(5, 20.0).unwrap(), &[1.0, 0.5]);
        for (centre, corner) in [(Centre::Pixel, 0), (Centre::Corner, 1)] {
            for down in -3..=3 {
                let weights = |coc_px: f32, down| {
                    let mut row = Vec::new();
                    sprites.row(
                        Sprite::from_coc_px(coc_px),
                        &Place { centre, down, border: INNER },
                        40,
                        &mut row,
                    );
                    row
                };
                let (mut turned, front) = (weights(7.0, corner - down), weights(-7.0, down));
                turned.reverse();
                // About a pixel the last column, one more than the first, is empty.
                let shift = 1 - corner as usize;
                for (a, b) in turned[shift..].iter().zip(&front) {
                    assert!((a - b).abs() < 1e-7, "{centre:?}, {down} rows down: {a}, {b}");
                }
            }
        }
    }
}
