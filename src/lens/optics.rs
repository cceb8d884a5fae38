//! The properties of a lens that its rays depend on, apart from focus: the aperture's shape, the barrel that cuts it off towards the frame's
//! corners, and the shift of rays by aberrations.
//!
//! A ray of picture point `p` through lens point `u` passes CoC depth `c` at `p + ε(u) + c·u`. Without aberrations `ε` is 0. To the
//! third order (Welford 1986, "Aberrations of Optical Systems", chapter 7):
//!
//! * *Spherical aberration* focuses the aperture's edge at another distance than its centre: `ε = s (|u|² − ⅔) u`, with `s` the CoC radius
//!   of the edge's rays where those of the centre meet. The term −⅔ is the best focus: it minimises the blur of surfaces in focus,
//!   whose root mean square is `s / 6`.
//! * *Axial colour* focuses red and blue at another distance than green: `ε = a·u`, with `a` each colour's CoC radius where green is in
//!   focus.
//! * *Cat's eye*: seen from a position `h` of the field (1 in the frame's corners), a barrel as wide as the aperture is offset by `κ·h`
//!   from it, and only rays with `|u − κ·h| ≤ 1` pass.
//!
//! The effects on the picture as a whole, which do not depend on the blur, are declared here too: *lateral colour*, by which the red and
//! blue pictures are larger or smaller than the green one, and the *falloff* of brightness towards the corners: the fourth power of the
//! cosine of the field angle, times the share of the aperture's light that passes the barrel.

use super::views::{moved_views, views, views_in_turns};
use super::{Aperture, ApertureImage, Field, View, aperture_radius};
use crate::error::Error;
use crate::settings::Settings;
use glam::Vec2;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// Position of the plane in which spherical aberration blurs least: see the module's head.
const BEST_FOCUS: f32 = 2.0 / 3.0;

/// The properties of a lens that its rays depend on, apart from focus.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Optics {
    /// The aperture's outline; with an image, only its squeeze is used.
    pub aperture: Aperture,
    /// Transmittance at each point of the aperture; without an image it is 1 within the outline.
    #[serde(skip)]
    pub image: Option<Arc<ApertureImage>>,
    /// Offset of the barrel from the aperture, seen from the frame's corners, in aperture radii.
    pub cats_eye: f32,
    /// CoC radius in picture pixels of the edge's rays where those of the centre meet.
    pub spherical_px: f32,
    /// CoC radius of red, green and blue where green is in focus, in picture pixels.
    pub axial_px: [f32; 3],
    /// Shift of red, green and blue away from the axis in the frame's corners, in picture pixels.
    pub lateral_px: [f32; 3],
    /// Exponent of the falloff of brightness: 1 for the falloff of the lens, 0 for none.
    pub vignetting: f32,
}

/// The lens samples of a picture: one set for all colours, or one for each of red, green and blue.
#[derive(Debug, Clone, PartialEq)]
pub struct Rays {
    sets: Vec<Vec<View>>,
}

impl Rays {
    /// The same views for all colours.
    pub fn alike(views: Vec<View>) -> Self {
        Self { sets: vec![views] }
    }

    /// The sets, each with the channels that it renders: 0, 1, 2 for red, green, blue, and 3 for alpha, which uses green's views.
    pub fn sets(&self) -> impl Iterator<Item = (&[View], &'static [usize])> {
        let channels: &[&[usize]] =
            if self.sets.len() == 1 { &[&[0, 1, 2, 3]] } else { &[&[0], &[1, 3], &[2]] };
        self.sets.iter().map(Vec::as_slice).zip(channels.iter().copied())
    }

    /// Only view `i` of every set.
    pub fn single(&self, i: usize) -> Self {
        Self { sets: self.sets.iter().map(|views| vec![views[i]]).collect() }
    }

    /// The views of green.
    pub fn green(&self) -> &[View] {
        &self.sets[self.sets.len() / 2]
    }
}

impl Optics {
    /// The lens of `settings`, for a picture with this position in its `field`.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for a setting out of its range, for aberrations that displace light by more than the
    /// picture, and for a black aperture image.
    pub fn new(settings: &Settings, field: &Field) -> Result<Self, Error> {
        let lens = &settings.lens;
        lens.check()?;
        let straight = Aperture::new(lens.blades.value, lens.rotation_deg.value)?;
        let aperture = straight
            .curved(lens.blade_curvature.value)?
            .squeezed(lens.squeeze.value)?
            .in_pixels(field.pixel_aspect);
        let image = settings.mask.as_ref().map(|mask| ApertureImage::new(mask, lens.rotation_deg.value));
        let px_per_um = 1e-3 * f64::from(field.focal_length_px) / f64::from(lens.focal_length_mm.value);
        // A defocus of 1 µm along the axis at the sensor blurs to a CoC diameter of 1 µm over the f-number.
        let radius = f64::from(aperture_radius(lens.squeeze.value, field.pixel_aspect));
        let coc_px_per_um = 0.5 / f64::from(lens.f_number.value) * px_per_um * radius;
        let px = |um: f32, px_per_um: f64| (f64::from(um) * px_per_um) as f32;
        let colors = |[red, blue]: [f32; 2]| [red, 0.0, blue];
        let optics = Self {
            aperture,
            image: image.transpose()?.map(Arc::new),
            cats_eye: lens.cats_eye.value,
            spherical_px: px(lens.spherical_um.value, coc_px_per_um),
            // A colour that focuses farther behind the lens is blurred like a nearer object: its CoC is negative.
            axial_px: colors(lens.axial_color_um.value).map(|farther| px(-farther, coc_px_per_um)),
            lateral_px: colors(lens.lateral_color_um.value).map(|farther| px(farther, px_per_um)),
            vignetting: lens.vignetting.value,
        };
        optics.check_displacement(field)?;
        Ok(optics)
    }

    /// Refuses aberrations that displace light by more than the picture's half diagonal.
    fn check_displacement(&self, field: &Field) -> Result<(), Error> {
        let displacement_px = self.max_displacement_px();
        if displacement_px == 0.0 || displacement_px < field.half_diagonal_px {
            return Ok(());
        }
        Err(Error::settings("the aberrations displace light by more than half of the picture's diagonal")
            .with("found", format!("{displacement_px} px of {} px", field.half_diagonal_px))
            .help("lower `spherical_um`, `axial_color_um` or `lateral_color_um`, or raise `f_number`"))
    }

    /// A lens with this aperture and without aberrations.
    pub fn from_aperture(aperture: Aperture) -> Self {
        Self {
            aperture,
            image: None,
            cats_eye: 0.0,
            spherical_px: 0.0,
            axial_px: [0.0; 3],
            lateral_px: [0.0; 3],
            vignetting: 0.0,
        }
    }

    /// `count` views, evenly spread over the aperture's light.
    pub fn rays(&self, count: usize) -> Rays {
        self.aberrated(&views(count, Aperture::DISC))
    }

    /// `count` rays for every row of a picture: row `y` has set `y mod n` of the `n` sets.
    pub fn rays_in_turns(&self, count: usize) -> Vec<Rays> {
        views_in_turns(count).iter().map(|views| self.aberrated(views)).collect()
    }

    /// `count` views rotated by `angle` on the lens and moved by `shift` in the pixel: see [`moved_views`].
    pub(crate) fn moved_rays(&self, count: usize, angle: f32, shift: Vec2) -> Rays {
        self.aberrated(&moved_views(count, angle, shift))
    }

    /// The rays of this lens for the views `disc` of a round aperture.
    fn aberrated(&self, disc: &[View]) -> Rays {
        let on_lens: Vec<View> =
            disc.iter().map(|view| View { lens: self.lens_point(view.lens), ..*view }).collect();
        let shifted = |axial_px: f32| {
            on_lens.iter().map(|view| View { shift: self.shift(view.lens, axial_px), ..*view }).collect()
        };
        if self.has_axial_color() {
            Rays { sets: self.axial_px.map(shifted).into() }
        } else {
            Rays::alike(shifted(0.0))
        }
    }

    /// Largest displacement in the picture by aberrations, in addition to the CoC radius, in pixels.
    pub fn max_displacement_px(&self) -> f32 {
        self.lateral_px.iter().fold(0.0, |max: f32, lateral| max.max(lateral.abs())) + self.longest_shift_px()
    }

    /// Number of sets of rays that a picture needs.
    pub fn ray_sets(&self) -> usize {
        if self.has_axial_color() { 3 } else { 1 }
    }

    /// Whether each colour has its own rays.
    pub fn has_axial_color(&self) -> bool {
        self.axial_px != [0.0; 3]
    }

    /// Maps a point of the unit disc to the aperture, so that equal areas of the disc get equal light.
    pub(super) fn lens_point(&self, point: Vec2) -> Vec2 {
        match &self.image {
            Some(image) => {
                // In the lens as seen from the camera: see the head of `aperture`.
                let seen = image.lit_point(point);
                Vec2::new(-seen.x, seen.y) * self.aperture.scale()
            }
            None => self.aperture.warp_disc(point),
        }
    }

    /// Shift by aberrations, in the picture, of the ray through `lens`, in pixels.
    fn shift(&self, lens: Vec2, axial_px: f32) -> Vec2 {
        (self.spherical_px * (lens.length_squared() - BEST_FOCUS) + axial_px) * lens
    }

    /// Largest shift of a ray by aberrations, in the picture, in pixels.
    pub fn longest_shift_px(&self) -> f32 {
        // |ρ³ − ⅔ρ| is largest at the edge.
        let axial = self.axial_px.iter().fold(0.0, |max: f32, axial| max.max(axial.abs()));
        (1.0 - BEST_FOCUS) * self.spherical_px.abs() + axial
    }

    /// The linear and the cubic coefficient of the spherical shift, measured from best focus: a ray through `|u|` lands at the distance
    /// `(first + second·|u|²)·|u|`, in picture pixels.
    pub fn spherical_terms(&self) -> [f32; 2] {
        [-BEST_FOCUS * self.spherical_px, self.spherical_px]
    }

    /// Signed distance from the barrel's edge of the ray through `lens`, seen from position `height` of the field, in aperture radii;
    /// negative where the ray does not pass.
    #[inline]
    pub(crate) fn within_barrel(&self, lens: Vec2, height: Vec2) -> f32 {
        1.0 - (lens - self.cats_eye * height).length()
    }

    /// The columns of picture row `y` from which a ray through `lens` passes the barrel with a [`Self::within_barrel`] of at least `within`.
    pub(crate) fn columns(&self, lens: Vec2, y: usize, field: &Field, within: f32) -> Range<i32> {
        let height = field.height(Vec2::new(0.0, y as f32 + 0.5));
        let across = (1.0 - within).powi(2) - (lens.y - self.cats_eye * height.y).powi(2);
        if across <= 0.0 {
            return 0..0;
        }
        let edge = |x: f32| {
            let place = field.axis_px.x + x / self.cats_eye * field.half_diagonal_px;
            (place - 0.5).clamp(-1e9, 1e9)
        };
        edge(lens.x - across.sqrt()).ceil() as i32..edge(lens.x + across.sqrt()).floor() as i32 + 1
    }

    /// Light that passes the aperture, as an area in squared aperture radii.
    pub fn area(&self) -> f32 {
        self.image.as_ref().map_or_else(
            || self.aperture.area(),
            |image| PI * image.mean() * self.aperture.scale().element_product(),
        )
    }

    /// Mean transmittance over a square of `side` about the lens point `lens`, both in aperture radii; 1 without an image, for points
    /// within the outline.
    pub(crate) fn light_around(&self, lens: Vec2, side: f32) -> f32 {
        self.image
            .as_ref()
            .map_or(1.0, |image| image.around(Vec2::new(-lens.x, lens.y) / self.aperture.scale(), side))
    }

    /// The open interval of the line through the lens's centre along the unit vector `direction`, seen from position `height` of the
    /// field: the part within the outline, or with an image its circle, and within the barrel.
    pub(crate) fn open_along(&self, direction: Vec2, height: Vec2) -> [f32; 2] {
        let outline = if self.image.is_some() { self.aperture.without_blades() } else { self.aperture };
        let [before, behind] = [-outline.distance(-direction), outline.distance(direction)];
        if self.cats_eye <= 0.0 {
            return [before, behind];
        }
        let barrel = self.cats_eye * height;
        let middle = direction.dot(barrel);
        let half_squared = 1.0 - barrel.length_squared() + middle * middle;
        if half_squared <= 0.0 {
            return [0.0; 2];
        }
        [before.max(middle - half_squared.sqrt()), behind.min(middle + half_squared.sqrt())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(change: impl FnOnce(&mut Optics)) -> Optics {
        let mut optics = Optics::from_aperture(Aperture::DISC);
        change(&mut optics);
        optics
    }

    #[test]
    fn a_lens_without_aberrations_has_the_same_views_for_all_colours() {
        let rays = Optics::from_aperture(Aperture::DISC).rays(64);
        assert_eq!(rays, Rays::alike(views(64, Aperture::DISC)));
        assert_eq!(rays.sets().map(|(_, channels)| channels).collect::<Vec<_>>(), [[0, 1, 2, 3]]);
    }

    #[test]
    fn micrometres_at_the_sensor_are_pixels_of_the_picture() {
        use crate::settings::{Origin, ParameterValues, Values};
        let values = Values {
            focal_length_mm: Some(50.0),
            f_number: Some(2.0),
            spherical_um: Some(400.0),
            axial_color_um: Some([80.0, -40.0]),
            lateral_color_um: Some([30.0, -10.0]),
            ..Values::default()
        };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        // 100 px a millimetre.
        let field = Field { focal_length_px: 5000.0, ..Field::from_picture_size(3600, 2400) };
        let optics = Optics::new(&settings, &field).unwrap();
        // A focus 400 µm in front of the sensor is a disc of 400 / 2 µm on it, of radius 100 µm or 10 px, like a point behind focus;
        // a focus farther from the lens is blurred like a point in front of focus.
        assert!((optics.spherical_px - 10.0).abs() < 1e-4, "{}", optics.spherical_px);
        let [red, green, blue] = optics.axial_px;
        assert!((red + 2.0).abs() < 1e-4 && green == 0.0 && (blue - 1.0).abs() < 1e-4, "{red}, {blue}");
        let [red, green, blue] = optics.lateral_px;
        assert!((red - 3.0).abs() < 1e-4 && green == 0.0 && (blue + 1.0).abs() < 1e-4, "{red}, {blue}");
        let displacement_px = optics.max_displacement_px();
        assert!((displacement_px - 3.0 - 10.0 / 3.0 - 2.0).abs() < 1e-3, "{displacement_px}");
    }

    #[test]
    fn spherical_aberration_blurs_least_in_focus_by_a_sixth_of_itself() {
        let optics = lens(|lens| lens.spherical_px = 6.0);
        let rms = |defocus_px: f32| {
            let views = optics.rays(1024);
            let land = |view: &View| (view.shift + defocus_px * view.lens).length_squared();
            (views.green().iter().map(land).sum::<f32>() / 1024.0).sqrt()
        };
        assert!((rms(0.0) - 1.0).abs() < 0.01, "{}", rms(0.0));
        assert!(rms(0.5) > rms(0.0) && rms(-0.5) > rms(0.0), "{} and {}", rms(-0.5), rms(0.5));
        let longest = optics.rays(1024).green().iter().map(|view| view.shift.length()).fold(0.0, f32::max);
        assert!((longest - optics.longest_shift_px()).abs() < 0.1, "{longest}");
    }

    #[test]
    fn axial_colour_shifts_the_rays_of_each_colour_by_its_own_radius() {
        let optics = lens(|lens| lens.axial_px = [-2.0, 0.0, 1.5]);
        let rays = optics.rays(32);
        let sets: Vec<_> = rays.sets().collect();
        for ((views, channels), (axial, channel)) in sets.into_iter().zip([(-2.0, 0), (0.0, 1), (1.5, 2)]) {
            assert_eq!(channels[0], channel);
            assert!(views.iter().all(|view| (view.shift - axial * view.lens).length() < 1e-6), "{axial}");
        }
        assert_eq!(optics.longest_shift_px(), 2.0);
    }

    #[test]
    fn the_columns_of_a_view_are_those_from_which_it_passes_the_barrel() {
        let optics = lens(|lens| lens.cats_eye = 0.9);
        let field = Field::from_picture_size(64, 36);
        for (view, y) in views(32, Aperture::DISC).iter().flat_map(|view| [0, 17, 35].map(|y| (view, y))) {
            for min in [0.0, -0.1, 0.2] {
                let columns = optics.columns(view.lens, y, &field, min);
                for x in 0..64 {
                    let within = optics
                        .within_barrel(view.lens, field.height(Vec2::new(x as f32 + 0.5, y as f32 + 0.5)));
                    if (within - min).abs() > 1e-4 {
                        assert_eq!(columns.contains(&x), within > min, "{view:?} at {x}, {y}");
                    }
                }
            }
        }
    }

    #[test]
    fn an_image_is_upright_behind_focus() {
        // Light in the upper half only: behind focus a point q lights p = q − c·u, and up in the picture is −y.
        let values = (0..400).map(|i| f32::from(u8::from(i / 20 < 8))).collect();
        let mask = crate::settings::Mask { name: "up".to_owned(), width: 20, height: 20, values };
        let image = ApertureImage::new(&mask, 0.0).unwrap();
        let optics = lens(|lens| lens.image = Some(Arc::new(image)));
        assert!(optics.rays(64).green().iter().all(|view| view.lens.y > 0.15), "p.y < q.y");
        assert!(optics.light_around(Vec2::new(0.0, 0.6), 0.1) > 0.99);
        assert!(optics.light_around(Vec2::new(0.0, -0.6), 0.1) < 0.01);
    }
}
