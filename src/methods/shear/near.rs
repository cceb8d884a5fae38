//! Smoothing of what surfaces nearer than focus show, by the gap between lens samples.
//!
//! Few views see a strongly blurred near surface as few copies of it: whatever lies behind shows their edges as a faint weave, because from
//! pixel to pixel the number of rays that the surface stops changes in steps. What is exact there is as smooth as the blur, so steps as
//! narrow as the gap between lens samples are noise. The prefilter removes them from the surface's colours, this from its edges.
//!
//! Painting keeps apart what rays gather from near surfaces ([`share`] says how far a surface is one): their colour `S`, the share `w` of
//! the rays that they stop, and the mean CoC radius of what they hit. With `W` and `T`, the smoothed `w` and `S`, a pixel of colour `p`
//! becomes
//!
//! ```text
//!   p + (T − S) − (W − w) · B        B = (p − S + ε T/W) / (1 − w + ε)
//! ```
//!
//! where `B` is the mean colour of what the rays hit that pass, as this pixel sees it: what lies behind is not smoothed. Where hardly a ray
//! passes, it is that of the near surfaces. Alpha is filtered alike, with `S = w`: one colour stays that colour.
//!
//! A surface that is near in full reaches by the box's radius farther than its blur, up to a ninth of the CoC radius at 64 views.
//!
//! The filter is a box along rows, then along columns, of half the prefilter's variance at the near surfaces' mean CoC radius. It vanishes
//! as the views become many ([`FEW_VIEWS`]), and where no surface is near.

use super::prefilter::{self, MIN_VARIANCE};
use super::resolve::smooth_step;
use crate::image::Plane;
use crate::parallel;
use pulp::{Arch, NullaryFnOnce};
use std::ops::Range;

/// CoC radius in picture pixels from which on a surface before the plane of focus begins to count as near, and from which on it does in
/// full. Narrower blur has no steps that are wider than a pixel.
pub(super) const FROM_PX: f32 = 12.0;

/// See [`FROM_PX`].
pub(super) const FULL_FROM_PX: f32 = 16.0;

/// Variance of the filter as a share of the prefilter's, for up to [`FEW_VIEWS`].
const SHARE_OF_VARIANCE: f32 = 0.5;

/// A step in the share of rays is at most that of one view: of more views it is too low to be seen, and the filter fades.
const FEW_VIEWS: usize = 512;

/// Largest radius of the box, in pixels.
pub(super) const MAX_RADIUS_PX: f32 = 8.0;

/// Pixels past either end of a row that the box can reach.
const PAD: usize = MAX_RADIUS_PX as usize + 1;

/// Side of the tiles over which the mean CoC radius is taken, in pixels.
const TILE: usize = 8;

/// The weight of near surfaces' colour in that of what rays hit that pass them: `ε`.
const FEW_RAYS: f32 = 0.02;

/// Rows before and after a row on which its smoothing may depend: those that the box reaches, and the tiles around theirs.
pub(super) const SURROUNDINGS: usize = 4 * TILE;

/// Radius per pixel of CoC radius of a box of the filter's variance, where it is large, for `views` views and the prefilter's `strength`.
pub(super) fn radius_per_coc(views: usize, strength: f32) -> f32 {
    let few = (FEW_VIEWS as f32 / views as f32).min(1.0);
    prefilter::radius_per_coc(views, strength) * (SHARE_OF_VARIANCE * few).sqrt()
}

/// How far a fragment of CoC radius `coc_px` counts as near: 0 … 1.
pub(super) fn share(coc_px: f32) -> f32 {
    smooth_step((-coc_px - FROM_PX) / (FULL_FROM_PX - FROM_PX))
}

/// What the rays of each pixel gather from near surfaces, as means over its rays.
#[derive(Debug)]
pub(super) struct NearLight {
    /// Number of rows that are painted; the planes may have more.
    pub(super) rows: usize,
    /// Share of the rays that near surfaces stop: for red, for green and alpha, and for blue, or for all of them.
    pub(super) shares: Vec<Plane>,
    /// CoC radius of these surfaces in pixels, positive, weighted by the share of green and alpha.
    pub(super) radius_px: Plane,
    /// Red, green and blue.
    pub(super) color: [Plane; 3],
}

impl NearLight {
    /// The index of the share of the rays of channel `channel` of a picture.
    fn share_index(&self, channel: usize) -> usize {
        match (self.shares.len(), channel) {
            (1, _) | (_, 0) => 0,
            (_, 2) => 2,
            _ => 1,
        }
    }

    /// All planes: CoC radius, red, green, blue, and the shares.
    pub(super) fn planes_mut(&mut self) -> impl Iterator<Item = &mut Plane> {
        std::iter::once(&mut self.radius_px).chain(&mut self.color).chain(&mut self.shares)
    }

    /// The planes to smooth: red, green, blue, and the shares.
    fn smoothed(&self) -> Vec<&Plane> {
        self.color.iter().chain(&self.shares).collect()
    }

    /// Smooths the near light of `rows` by `radius_per_coc` ([`radius_per_coc()`]), and puts it into these rows of red, green, blue and alpha,
    /// the `picture`. Row 0 is the picture's first one, or [`SURROUNDINGS`] before `rows` and the first of a tile; likewise the last one.
    pub(super) fn smooth(&self, picture: [&mut [f32]; 4], rows: Range<usize>, radius_per_coc: f32) {
        let (width, radii) = (self.radius_px.width(), Radii::new(self, radius_per_coc));
        let reach = radii.reach();
        if width == 0 || reach == 0 {
            return;
        }
        let [red, green, blue, alpha] = picture.map(|values| values.chunks_mut(BAND * width));
        parallel::for_each_with(
            red.zip(green).zip(blue).zip(alpha),
            &|| Band::new(width, reach, self.smoothed().len()),
            &|band, i, (((red, green), blue), alpha)| {
                let first = rows.start + i * BAND;
                let rows = first..first + alpha.len() / width;
                if band.fill(self, &radii, rows.clone()) {
                    band.blend(self, rows, [red, green, blue, alpha]);
                }
            },
        );
    }
}

/// Rows that are smoothed together: few enough that they stay in the cache.
const BAND: usize = 32;

/// Some rows, smoothed along rows, with as many rows before and after them as the box reaches.
struct Band {
    width: usize,
    reach: usize,
    /// Radius of the box in pixels at each pixel of the rows.
    radii_px: Vec<f32>,
    /// The planes of [`NearLight::smoothed`]: the rows, smoothed along rows.
    planes: Vec<Vec<f32>>,
    /// A row with [`PAD`] pixels more at either end.
    padded: Vec<f32>,
    /// The planes of a row, smoothed along columns as well.
    smooth: Vec<Vec<f32>>,
    arch: Arch,
}

impl Band {
    fn new(width: usize, reach: usize, planes: usize) -> Self {
        let rows = BAND + 2 * reach;
        Self {
            width,
            reach,
            radii_px: vec![0.0; rows * width],
            planes: vec![vec![0.0; rows * width]; planes],
            padded: vec![0.0; width + 2 * PAD],
            smooth: vec![vec![0.0; width]; planes],
            arch: Arch::new(),
        }
    }

    /// The values of row `i` of the band and those around it.
    fn row(&self, i: usize) -> Range<usize> {
        i * self.width..(i + 1) * self.width
    }

    /// Smooths `rows` of `near` and those around them along rows. Returns whether there is anything to smooth along columns.
    fn fill(&mut self, near: &NearLight, radii: &Radii, rows: Range<usize>) -> bool {
        let (reach, last) = (self.reach, near.rows - 1);
        let mut any = false;
        for i in 0..rows.len() + 2 * reach {
            let (y, values) = ((rows.start + i).saturating_sub(reach).min(last), self.row(i));
            let radii_px = &mut self.radii_px[values.clone()];
            let is_smoothed = radii.fill_row(y, radii_px);
            any |= is_smoothed & (reach..reach + rows.len()).contains(&i);
            let taps = if is_smoothed { taps(radii_px) } else { 0 };
            for (plane, out) in near.smoothed().into_iter().zip(&mut self.planes) {
                let (row, out) = (plane.row(y), &mut out[values.clone()]);
                out.copy_from_slice(row);
                if taps > 0 {
                    pad(row, &mut self.padded);
                    let sides = |away: usize| [&self.padded[PAD - away..], &self.padded[PAD + away..]];
                    (1..=taps).for_each(|away| {
                        self.arch.dispatch(AddTap { out, sides: sides(away), radii_px, away });
                    });
                    self.arch.dispatch(Normalize { out, radii_px });
                }
            }
        }
        any
    }

    /// Smooths `rows` of `near` along columns and puts them into those of the picture.
    fn blend(&mut self, near: &NearLight, rows: Range<usize>, mut picture: [&mut [f32]; 4]) {
        for (i, y) in rows.enumerate() {
            let own = self.row(i + self.reach);
            let radii_px = &self.radii_px[own.clone()];
            let taps = taps(radii_px);
            if taps == 0 {
                continue;
            }
            for (plane, out) in self.planes.iter().zip(&mut self.smooth) {
                out.copy_from_slice(&plane[own.clone()]);
                for away in 1..=taps {
                    let rows = [i + self.reach - away, i + self.reach + away];
                    let sides = rows.map(|row| &plane[row * self.width..(row + 1) * self.width]);
                    self.arch.dispatch(AddTap { out, sides, radii_px, away });
                }
                self.arch.dispatch(Normalize { out, radii_px });
            }
            let pixels = self.row(i);
            for (channel, picture) in picture.iter_mut().enumerate() {
                let share = near.share_index(channel);
                let shares = [near.shares[share].row(y), &self.smooth[3 + share]];
                let light = match near.color.get(channel) {
                    Some(color) => [color.row(y), &self.smooth[channel]],
                    None => shares,
                };
                self.arch.dispatch(Blend { row: &mut picture[pixels.clone()], shares, light });
            }
        }
    }
}

/// Fills `padded` with `row`, and its ends repeated.
fn pad(row: &[f32], padded: &mut [f32]) {
    let end = PAD + row.len();
    padded[..PAD].fill(row[0]);
    padded[PAD..end].copy_from_slice(row);
    padded[end..].fill(row[row.len() - 1]);
}

/// Radius of the box at each pixel: between the middles of tiles, that of tiles and their neighbours.
struct Radii {
    /// Radius in pixels at the middle of each tile.
    tiles: Plane,
}

impl Radii {
    fn new(near: &NearLight, radius_per_coc: f32) -> Self {
        let share = &near.shares[near.share_index(1)];
        let (shares, radii) = (tile_sums(share, near.rows), tile_sums(&near.radius_px, near.rows));
        let around = |plane: &Plane, x: usize, y: usize| {
            let (last_x, last_y) = (plane.width() - 1, plane.height() - 1);
            let row = |y: usize| {
                plane.get(x.saturating_sub(1), y) + 2.0 * plane.get(x, y) + plane.get((x + 1).min(last_x), y)
            };
            row(y.saturating_sub(1)) + 2.0 * row(y) + row((y + 1).min(last_y))
        };
        let tiles = Plane::from_fn(shares.width(), shares.height(), |x, y| {
            let share = around(&shares, x, y);
            if share > 0.0 { radius_px(around(&radii, x, y) / share, radius_per_coc) } else { 0.0 }
        });
        Self { tiles }
    }

    /// Pixels to either side that the largest box covers, at least in part.
    fn reach(&self) -> usize {
        taps(self.tiles.values())
    }

    /// Fills `radii_px` with those of the pixels of row `y`. Returns whether any is not 0.
    fn fill_row(&self, y: usize, radii_px: &mut [f32]) -> bool {
        let [above, below] = tiles_around(y, self.tiles.height()).map(|tile| self.tiles.row(tile));
        if above.iter().chain(below).all(|&radius_px| radius_px == 0.0) {
            radii_px.fill(0.0);
            return false;
        }
        let (down, count) = (along_tile(y), above.len());
        let at = |tile: usize| above[tile] + down * (below[tile] - above[tile]);
        // Half tiles: all pixels of one lie between the middles of the same two tiles.
        for (half, pixels) in radii_px.chunks_mut(TILE / 2).enumerate() {
            let first = half * TILE / 2;
            let [left, right] = tiles_around(first, count).map(at);
            for (i, out) in pixels.iter_mut().enumerate() {
                *out = left + along_tile(first + i) * (right - left);
            }
        }
        true
    }
}

/// Sums over tiles of the first `rows` rows of `plane`.
fn tile_sums(plane: &Plane, rows: usize) -> Plane {
    let mut sums = Plane::zeros(plane.width().div_ceil(TILE), rows.div_ceil(TILE));
    for y in 0..rows {
        let tiles = sums.row_mut(y / TILE);
        plane.row(y).chunks(TILE).zip(tiles).for_each(|(pixels, sum)| *sum += pixels.iter().sum::<f32>());
    }
    sums
}

/// The two tiles of `count` between whose middles pixel `at` lies; one twice before the first middle and after the last.
fn tiles_around(at: usize, count: usize) -> [usize; 2] {
    let after = (at + TILE / 2) / TILE;
    [after.saturating_sub(1), after.min(count - 1)]
}

/// How far pixel `at` is from the one to the other.
fn along_tile(at: usize) -> f32 {
    (((at + TILE / 2) % TILE) as f32 + 0.5) / TILE as f32
}

/// Radius in pixels of the box at the CoC radius `coc_px`. A box that is `1 + 2 r` wide adds the variance `(r² + r)/3`.
fn radius_px(coc_px: f32, radius_per_coc: f32) -> f32 {
    let variance = (coc_px * radius_per_coc).powi(2) / 3.0;
    // Fades in from 0 at the smallest variance, as the prefilter does.
    let variance = (variance - MIN_VARIANCE * MIN_VARIANCE / variance.max(MIN_VARIANCE)).max(0.0);
    (0.5 * ((1.0 + 12.0 * variance).sqrt() - 1.0)).min(MAX_RADIUS_PX)
}

/// Pixels to either side that boxes of these radii cover, at least in part.
fn taps(radii_px: &[f32]) -> usize {
    radii_px.iter().fold(0.0, |most: f32, &radius_px| if radius_px > most { radius_px } else { most }).ceil()
        as usize
}

/// Adds to `out` the pixels on both `sides`, `away` from the middle of boxes of these radii, as far as the boxes cover them.
struct AddTap<'a> {
    out: &'a mut [f32],
    sides: [&'a [f32]; 2],
    radii_px: &'a [f32],
    away: usize,
}

impl NullaryFnOnce for AddTap<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { out, sides: [before, after], radii_px, away } = self;
        for (((out, before), after), radius_px) in out.iter_mut().zip(before).zip(after).zip(radii_px) {
            *out += (radius_px + 1.0 - away as f32).clamp(0.0, 1.0) * (before + after);
        }
    }
}

/// Divides `out` by the width of boxes of these radii.
struct Normalize<'a> {
    out: &'a mut [f32],
    radii_px: &'a [f32],
}

impl NullaryFnOnce for Normalize<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { out, radii_px } = self;
        out.iter_mut().zip(radii_px).for_each(|(out, radius_px)| *out /= 1.0 + 2.0 * radius_px);
    }
}

/// Puts smooth near light into `row` of the picture: `shares` are the shares of rays that near surfaces stop, as painted and smooth, `light`
/// what these rays gather, as painted and smooth.
struct Blend<'a> {
    row: &'a mut [f32],
    shares: [&'a [f32]; 2],
    light: [&'a [f32]; 2],
}

impl NullaryFnOnce for Blend<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { row, shares: [painted, smooth], light: [own, light] } = self;
        let near = painted.iter().zip(smooth).zip(own.iter().zip(light));
        for (value, ((&w, &smooth_w), (&own, &light))) in row.iter_mut().zip(near) {
            let color = light / smooth_w.max(f32::MIN_POSITIVE);
            let behind = (*value - own + FEW_RAYS * color) / (1.0 - w + FEW_RAYS);
            let filtered = *value + (light - own) - (smooth_w - w) * behind;
            // Light may be infinite.
            *value = if filtered.is_finite() { filtered } else { *value };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    const SIZE: (usize, usize) = (61, 43);

    /// Radius per pixel of CoC radius for 64 views.
    fn for_64_views() -> f32 {
        radius_per_coc(64, 1.4)
    }

    /// A picture of an opaque `behind` of which near surfaces of colour `near` and CoC radius 30 hide the share `share` of each pixel's rays.
    fn picture(
        share: impl Fn(usize, usize) -> f32,
        near: f32,
        behind: impl Fn(usize, usize) -> f32,
    ) -> (Image, NearLight) {
        let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(SIZE.0, SIZE.1, value);
        let image = Image::from_fn(SIZE.0, SIZE.1, |x, y| {
            let value = share(x, y) * near + (1.0 - share(x, y)) * behind(x, y);
            [value, value, value, 1.0]
        });
        let light = NearLight {
            rows: SIZE.1,
            shares: vec![plane(&share)],
            radius_px: plane(&|x, y| 30.0 * share(x, y)),
            color: std::array::from_fn(|_| plane(&|x, y| near * share(x, y))),
        };
        (image, light)
    }

    /// Smooths all rows of `near` in `image`, for 64 views.
    fn smooth(near: &NearLight, image: &mut Image) {
        near.smooth(image.planes.each_mut().map(Plane::values_mut), 0..SIZE.1, for_64_views());
    }

    fn largest_change(before: &Image, after: &Image) -> f32 {
        let planes = before.planes.iter().zip(&after.planes);
        let values = planes.flat_map(|(before, after)| before.values().iter().zip(after.values()));
        values.fold(0.0, |most: f32, (before, after)| most.max((after - before).abs()))
    }

    /// Shares of rays as of few views: whole numbers out of 64 about a mean.
    fn noisy(x: usize, y: usize) -> f32 {
        (32.0 + ((x * 7 + y * 13) % 5) as f32 - 2.0) / 64.0
    }

    #[test]
    fn a_fragment_is_near_from_12_pixels_on_and_in_full_from_16_before_focus_only() {
        assert_eq!([40.0, 0.0, -12.0, -14.0, -16.0, -90.0].map(share), [0.0, 0.0, 0.0, 0.5, 1.0, 1.0]);
    }

    #[test]
    fn one_colour_stays_that_colour() {
        let (before, near) = picture(noisy, 0.7, |_, _| 0.7);
        let mut after = before.clone();
        smooth(&near, &mut after);
        assert!(largest_change(&before, &after) < 1e-6, "{}", largest_change(&before, &after));
    }

    #[test]
    fn the_noise_of_the_share_of_hidden_rays_falls_to_less_than_a_third() {
        let (before, near) = picture(noisy, 0.1, |_, _| 0.9);
        let mut after = before.clone();
        smooth(&near, &mut after);
        let deviation = |image: &Image| {
            let values = (8..35).flat_map(|y| (8..53).map(move |x| (x, y)));
            let squares: Vec<f32> = values.map(|(x, y)| (image.planes[0].get(x, y) - 0.5).powi(2)).collect();
            (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
        };
        assert!(deviation(&before) > 0.01, "noise: {}", deviation(&before));
        assert!(
            deviation(&after) < deviation(&before) / 3.0,
            "{} of {}",
            deviation(&after),
            deviation(&before)
        );
    }

    #[test]
    fn what_lies_behind_stays_sharp() {
        let (before, near) = picture(|_, _| 0.5, 0.2, |x, y| ((x + y) % 2) as f32);
        let mut after = before.clone();
        smooth(&near, &mut after);
        assert!(largest_change(&before, &after) < 1e-6, "{}", largest_change(&before, &after));
    }

    #[test]
    fn an_even_ramp_of_coverage_does_not_change_away_from_its_ends() {
        let (before, near) = picture(|x, _| 0.1 + 0.01 * x as f32, 0.2, |_, _| 0.9);
        let mut after = before.clone();
        smooth(&near, &mut after);
        for x in 9..52 {
            let change = (after.planes[0].get(x, 20) - before.planes[0].get(x, 20)).abs();
            assert!(change < 2e-4, "column {x}: {change}");
        }
    }

    #[test]
    fn a_changed_pixel_changes_nothing_beyond_the_box_and_the_tiles_of_its_radius() {
        let at = |x: usize, y: usize| (x, y) == (30, 20);
        let share = |x: usize, y: usize| if at(x, y) { 0.9 } else { noisy(x, y) };
        let ((mut one, near_one), (mut other, near_other)) =
            (picture(noisy, 0.1, |_, _| 0.9), picture(share, 0.1, |_, _| 0.9));
        smooth(&near_one, &mut one);
        smooth(&near_other, &mut other);
        let reach = radius_px(30.0, for_64_views()).ceil() as usize;
        assert!(reach <= 4, "{reach}");
        for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
            let change = (one.planes[0].get(x, y) - other.planes[0].get(x, y)).abs();
            let beyond = x.abs_diff(30).max(y.abs_diff(20)) > reach;
            // The radius is that of one CoC radius everywhere, but for rounding.
            assert!(!beyond || change < 1e-5, "{x}, {y}: {change}");
        }
    }

    #[test]
    fn a_box_has_the_variance_of_the_law_and_none_below_the_smallest() {
        let per_coc = for_64_views();
        for coc_px in [10.0, 30.0] {
            let r = radius_px(coc_px, per_coc);
            let wanted = (coc_px * per_coc).powi(2) / 3.0;
            assert!(
                ((r * r + r) / 3.0 / (wanted - MIN_VARIANCE.powi(2) / wanted) - 1.0).abs() < 1e-3,
                "{coc_px}: {r}"
            );
        }
        assert_eq!(radius_px(1.0, per_coc), 0.0, "narrower than the smallest");
        assert_eq!(radius_px(30.0, radius_per_coc(4096, 1.4)), 0.0, "of 4096 views");
    }
}
