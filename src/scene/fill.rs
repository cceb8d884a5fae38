//! Disocclusion fill: an estimated surface behind the last fragment, for stacks of one or two layers.
//!
//! A lens ray that passes all known fragments should hit something plausible: a farther surface from the neighbourhood. A
//! pyramid over the nearest layer keeps in each cell only the farthest cluster of CoC radii below it. Each pixel takes
//! the finest cell around it that lies behind its own last fragment, unless the cell is so coarse that no ray reaches that far. The estimate
//! fades where the pixel shows the background ([`Background`]): nothing is behind its fragments there.

use super::surface::CELL_PX;
use super::unmixing::{replace_blurred, unmixed_colors};
use super::{Background, Layer, Scene};
use crate::image::Plane;
use rayon::prelude::*;

/// Largest number of levels of the pyramid.
const MAX_LEVELS: usize = 9;

/// The farthest cluster of a cell: mean colour and CoC radius, and as weight the share of the cell that it covers.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    color: [f32; 3],
    coc_px: f32,
    weight: f32,
}

impl Cell {
    /// The cell with `share` of its weight, its colour premultiplied by it.
    fn faded(self, share: f32) -> Self {
        Self { color: self.color.map(|value| value * share), weight: self.weight * share, ..self }
    }
}

/// One level: `width × height` cells, row by row.
struct Level {
    width: usize,
    height: usize,
    cells: Vec<Cell>,
}

impl Scene {
    /// The scene at one sample per pixel, with an estimated surface as its last layer.
    #[must_use]
    pub fn filled(self) -> Self {
        let has_mixed_edges = self.supersample == 1;
        let mut scene = self.merged();
        let background = scene.background.as_deref();
        if let [picture] = &mut scene.layers[..]
            && has_mixed_edges
        {
            // Peels, and the samples of a pixel, hold each surface's own colours; one picture with depth has mixtures of two at every edge.
            replace_blurred(picture, &unmixed_colors(picture, &scene.antialiasing));
        }
        scene.layers.extend(estimated_layer(&scene.layers, background));
        scene
    }
}

/// The estimated surface, empty where no farther surface is near; `None` without layers.
fn estimated_layer(layers: &[Layer], background: Option<&Background>) -> Option<Layer> {
    let nearest = layers.first()?;
    let (width, height) = (nearest.width(), nearest.height());
    let mut levels = vec![base(nearest)];
    while let Some(last) = levels.last()
        && last.width.max(last.height) > 2
        && levels.len() < MAX_LEVELS
    {
        levels.push(coarser(last));
    }
    let cells: Vec<Cell> = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let hidden = background.map_or(1.0, |background| 1.0 - background.share().get(x, y));
            let behind = last_coc(layers, x, y).filter(|_| hidden > 0.0);
            behind.map_or(Cell::default(), |coc| cell_behind(&levels, x, y, coc).faded(hidden))
        })
        .collect();
    let plane =
        |value: &dyn Fn(&Cell) -> f32| Plane::from_fn(width, height, |x, y| value(&cells[y * width + x]));
    let color = std::array::from_fn(|k| plane(&|cell| cell.color[k]));
    Some(Layer { color, alpha: plane(&|cell| cell.weight), coc_px: plane(&|cell| cell.coc_px) })
}

/// CoC radius of the last fragment at `x, y`.
fn last_coc(layers: &[Layer], x: usize, y: usize) -> Option<f32> {
    layers.iter().rev().find(|layer| layer.alpha.get(x, y) > 0.0).map(|layer| layer.coc_px.get(x, y))
}

fn base(layer: &Layer) -> Level {
    let (width, height) = (layer.width(), layer.height());
    let cells = (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let alpha = layer.alpha.get(x, y);
            if alpha <= 0.0 {
                return Cell::default();
            }
            let color = layer.color_at(x, y).map(|value| value / alpha);
            Cell { color, coc_px: layer.coc_px.get(x, y), weight: 1.0 }
        })
        .collect();
    Level { width, height, cells }
}

/// The next coarser level: each cell keeps the farthest cluster of four cells.
fn coarser(level: &Level) -> Level {
    let (width, height) = (level.width.div_ceil(2), level.height.div_ceil(2));
    let cells = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let (x, y) = (i % width * 2, i / width * 2);
            let children = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| {
                level.cells[(y + dy).min(level.height - 1) * level.width + (x + dx).min(level.width - 1)]
            });
            farthest_cluster(&children)
        })
        .collect();
    Level { width, height, cells }
}

fn farthest_cluster(children: &[Cell]) -> Cell {
    let present = || children.iter().filter(|cell| cell.weight > 0.0);
    let farthest = present().map(|cell| cell.coc_px).fold(f32::NEG_INFINITY, f32::max);
    let mut mean = Mean::default();
    present().filter(|cell| cell.coc_px >= farthest - CELL_PX).for_each(|cell| mean.add(cell, cell.weight));
    // The lower bound keeps a cluster of one far pixel from vanishing on coarse levels.
    mean.cell((mean.weight / children.len() as f32).max(0.05))
}

/// The finest cell around `x, y` that lies behind `coc`; empty where no ray reaches as far as that cell is large.
fn cell_behind(levels: &[Level], x: usize, y: usize, coc: f32) -> Cell {
    let mut size = 1.0;
    for level in &levels[1..] {
        size *= 2.0;
        let mean = level.sample((x as f32 + 0.5) / size - 0.5, (y as f32 + 0.5) / size - 0.5, coc + CELL_PX);
        if mean.weight > 1e-4 {
            let cell = mean.cell(1.0);
            // A ray that passes a fragment at `coc` reaches depth `coc_px` at most |coc_px − coc| away from it.
            return if 0.7 * size > (cell.coc_px - coc).abs() + 2.0 { Cell::default() } else { cell };
        }
    }
    Cell::default()
}

impl Level {
    /// Bilinear interpolation at cell coordinates `x, y` of the cells behind `coc`.
    fn sample(&self, x: f32, y: f32, coc: f32) -> Mean {
        let mut mean = Mean::default();
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (cx, cy) = (x.floor() + dx, y.floor() + dy);
            let column = cx.clamp(0.0, self.width as f32 - 1.0) as usize;
            let row = cy.clamp(0.0, self.height as f32 - 1.0) as usize;
            let cell = self.cells[row * self.width + column];
            if cell.weight > 0.0 && cell.coc_px > coc {
                let weight = (1.0 - (x - cx).abs()) * (1.0 - (y - cy).abs());
                mean.add(&cell, weight * cell.weight + 1e-5);
            }
        }
        mean
    }
}

/// Accumulator of a weighted mean of cells.
#[derive(Default)]
struct Mean {
    color: [f32; 3],
    coc_px: f32,
    weight: f32,
}

impl Mean {
    fn add(&mut self, cell: &Cell, weight: f32) {
        self.color.iter_mut().zip(cell.color).for_each(|(sum, value)| *sum += weight * value);
        self.coc_px += weight * cell.coc_px;
        self.weight += weight;
    }

    /// The mean, as a cell of weight `weight`; an empty cell if nothing was added.
    fn cell(&self, weight: f32) -> Cell {
        if self.weight <= 0.0 {
            return Cell::default();
        }
        Cell { color: self.color.map(|sum| sum / self.weight), coc_px: self.coc_px / self.weight, weight }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A near red stripe in front of a far green wall, which is unknown behind the stripe.
    fn stripe() -> Layer {
        let near = |x: usize| (28..36).contains(&x);
        let plane = |f: &dyn Fn(usize) -> f32| Plane::from_fn(64, 32, |x, _| f(x));
        let color = [
            plane(&|x| f32::from(u8::from(near(x)))),
            plane(&|x| f32::from(u8::from(!near(x)))),
            plane(&|_| 0.0),
        ];
        Layer { color, alpha: plane(&|_| 1.0), coc_px: plane(&|x| if near(x) { -20.0 } else { 6.0 }) }
    }

    #[test]
    fn a_near_stripe_is_filled_with_the_surface_around_it() {
        let fill = estimated_layer(&[stripe()], None).unwrap();
        for x in 28..36 {
            assert_eq!(fill.alpha.get(x, 16), 1.0, "column {x} is filled");
            assert!((fill.coc_px.get(x, 16) - 6.0).abs() < 1e-4, "column {x} lies on the wall");
            assert!(fill.color_at(x, 16)[0] < 1e-6, "column {x} has nothing of the stripe's red");
            assert!((fill.color_at(x, 16)[1] - 1.0).abs() < 1e-5, "column {x} is the wall's green");
        }
    }

    #[test]
    fn nothing_is_filled_behind_the_farthest_surface() {
        let fill = estimated_layer(&[stripe()], None).unwrap();
        assert_eq!(fill.alpha.get(5, 16), 0.0, "no fill behind the wall");
    }

    #[test]
    fn nothing_is_filled_where_no_ray_can_reach() {
        // The stripe is little nearer than the wall: rays spread by less than the distance to the surroundings.
        let near = |x: usize| (8..56).contains(&x);
        let plane = |f: &dyn Fn(usize) -> f32| Plane::from_fn(64, 64, |x, _| f(x));
        let color = [0, 1, 2].map(|_| plane(&|_| 1.0));
        let layer =
            Layer { color, alpha: plane(&|_| 1.0), coc_px: plane(&|x| if near(x) { 0.0 } else { 3.0 }) };
        let fill = estimated_layer(&[layer], None).unwrap();
        assert_eq!(fill.alpha.get(32, 32), 0.0, "24 px from the wall, 3 px of blur");
    }
}
