//! Which colours of a picture are point samples, and which are averages over the pixel.

use super::StackKind;
use crate::image::Plane;
use std::sync::Arc;

/// How far the colours around each pixel are averages over the pixel: 0 where they are point samples, 1 where they and alpha are
/// averages (coverage), and between where the edges around do not tell, or tell both.
///
/// Point samples alias in focus, and need a picture that averages over the pixel; averages do not, and averaging them again would
/// soften them. [`Stack::from_peels`](super::Stack::from_peels) and [`read`](super::read()) find it out.
#[derive(Debug, Clone, PartialEq)]
pub struct Antialiasing(Share);

#[derive(Debug, Clone, PartialEq)]
enum Share {
    Everywhere(f32),
    ByPixel(Arc<Plane>),
}

impl Antialiasing {
    /// Point samples everywhere.
    pub const POINT_SAMPLES: Self = Self(Share::Everywhere(0.0));
    /// Averages over the pixel everywhere.
    pub const AVERAGES: Self = Self(Share::Everywhere(1.0));

    /// One share for each pixel of the picture, 0 … 1.
    pub fn by_pixel(share: Plane) -> Self {
        match share.values() {
            [first, rest @ ..] if rest.iter().all(|value| value == first) => Self(Share::Everywhere(*first)),
            _ => Self(Share::ByPixel(Arc::new(share))),
        }
    }

    /// The share at a pixel of the picture.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        match &self.0 {
            Share::Everywhere(share) => *share,
            Share::ByPixel(plane) => plane.get(x, y),
        }
    }

    /// The share of all pixels, if they have the same.
    pub fn everywhere(&self) -> Option<f32> {
        match self.0 {
            Share::Everywhere(share) => Some(share),
            Share::ByPixel(_) => None,
        }
    }

    /// The share by pixel; `None` if all have the same.
    pub fn plane(&self) -> Option<&Plane> {
        match &self.0 {
            Share::Everywhere(_) => None,
            Share::ByPixel(plane) => Some(plane),
        }
    }

    /// Mean over the picture.
    pub fn mean(&self) -> f64 {
        match &self.0 {
            Share::Everywhere(share) => f64::from(*share),
            Share::ByPixel(plane) => {
                let sum: f64 = plane.values().iter().map(|&share| f64::from(share)).sum();
                sum / plane.values().len() as f64
            }
        }
    }

    /// The same of another picture, whose plane `change` makes of this one's.
    #[must_use]
    pub(crate) fn changed(&self, change: impl FnOnce(&Plane) -> Plane) -> Self {
        self.plane().map_or_else(|| self.clone(), |plane| Self::by_pixel(change(plane)))
    }

    /// The same where the colours of peel 0 were replaced by averages over the pixel, to the share that `replaced` says of each pixel.
    #[must_use]
    pub(super) fn with_averages(&self, replaced: &Plane) -> Self {
        let share = |x, y| {
            let share = self.at(x, y);
            share + replaced.get(x, y) * (1.0 - share)
        };
        Self::by_pixel(Plane::from_fn(replaced.width(), replaced.height(), share))
    }

    /// The shares in words, as in "point samples 97.3 %, coverage 2.7 %".
    pub fn in_words(&self) -> String {
        let coverage = 100.0 * self.mean();
        format!("point samples {:.1} %, coverage {coverage:.1} %", 100.0 - coverage)
    }
}

impl From<StackKind> for Antialiasing {
    /// That of a stack which is of this kind everywhere. Samples of a supersampled stack become averages when they are merged.
    fn from(kind: StackKind) -> Self {
        match kind {
            StackKind::PointSampled => Self::POINT_SAMPLES,
            StackKind::Coverage | StackKind::Supersampled | StackKind::BeautyDepth => Self::AVERAGES,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_of_one_share_is_that_share_everywhere() {
        let even = Antialiasing::by_pixel(Plane::filled(4, 3, 0.25));
        assert_eq!((even.everywhere(), even.plane(), even.mean()), (Some(0.25), None, 0.25));
        let mixed = Antialiasing::by_pixel(Plane::from_fn(4, 1, |x, _| if x < 1 { 1.0 } else { 0.0 }));
        assert_eq!((mixed.everywhere(), mixed.mean()), (None, 0.25));
        assert_eq!([mixed.at(0, 0), mixed.at(1, 0)], [1.0, 0.0]);
        assert_eq!(mixed.in_words(), "point samples 75.0 %, coverage 25.0 %");
    }
}
