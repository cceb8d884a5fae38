//! The pictures of a comparison: the baseline, error maps against it, and crops.
//!
//! Memory: 6 bytes per pixel and picture, 12 MB at 1080p.

use super::crops::places;
use super::picture::Picture;
use super::{Baseline, Crop, Entry};
use crate::error::Error;
use crate::image::{Image, Plane};
use crate::metrics::Pair;

/// Pictures of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct Gallery {
    /// The picture without a lens.
    pub pinhole: Picture,
    /// The reference render, if there is one.
    pub reference: Option<Picture>,
    /// The pictures of the entries, in their order.
    pub entries: Vec<Picture>,
}

impl Gallery {
    /// A gallery of `pinhole` and `reference`, without entries.
    pub fn new(pinhole: &Image, reference: Option<&Image>) -> Self {
        Self { pinhole: Picture::new(pinhole), reference: reference.map(Picture::new), entries: Vec::new() }
    }

    /// Adds the picture of the next entry.
    pub fn add(&mut self, image: &Image) {
        self.entries.push(Picture::new(image));
    }

    /// What error maps and crops are measured against: the reference, or the most accurate of `entries` without one.
    pub fn baseline(&self, entries: &[Entry]) -> Option<Baseline> {
        if self.reference.is_some() {
            return Some(Baseline::Reference);
        }
        let best = entries.iter().max_by(|a, b| a.psnr_db().total_cmp(&b.psnr_db()))?;
        Some(Baseline::Entry(best.name.clone()))
    }

    /// The picture that `baseline` names.
    fn find(&self, baseline: &Baseline, entries: &[Entry]) -> Option<&Picture> {
        match baseline {
            Baseline::Reference => self.reference.as_ref(),
            Baseline::Entry(name) => self.entries.get(entries.iter().position(|entry| entry.name == *name)?),
        }
    }

    /// Calls `each` with the index of every entry except the baseline, and its FLIP at each pixel.
    ///
    /// # Errors
    /// Those of `each`.
    pub fn maps(
        &self,
        baseline: &Baseline,
        entries: &[Entry],
        mut each: impl FnMut(usize, Plane) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let Some(expected) = self.find(baseline, entries) else { return Ok(()) };
        let linear = expected.linear();
        for (i, picture) in
            self.entries.iter().enumerate().filter(|(_, picture)| !std::ptr::eq(*picture, expected))
        {
            each(i, Pair::new(&picture.linear(), &linear, 0)?.flip_map())?;
        }
        Ok(())
    }

    /// The crops in which the entries differ most, with the PSNR of each against the baseline. (The crops of a single entry are
    /// those in which it differs most from the pinhole picture and the reference.)
    pub fn crops(&self, baseline: &Baseline, entries: &[Entry]) -> Vec<Crop> {
        let Some(expected) = self.find(baseline, entries) else { return Vec::new() };
        let mut pictures: Vec<&Picture> = self.entries.iter().collect();
        if pictures.len() < 2 {
            pictures.extend(self.reference.iter().chain([&self.pinhole]));
        }
        let measured = |square| {
            let expected = expected.crop(square);
            let psnr_db = |picture: &Picture| picture.crop(square).psnr_db(&expected);
            Crop {
                x: square.x,
                y: square.y,
                side_px: square.side,
                pinhole_psnr_db: psnr_db(&self.pinhole),
                psnr_db: self.entries.iter().map(psnr_db).collect(),
            }
        };
        places(&pictures).into_iter().map(measured).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::entry;
    use super::*;

    fn grey(value: f32) -> Image {
        Image::from_fn(80, 80, |x, _| [value + (x / 40) as f32 * value; 4])
    }

    fn gallery(reference: Option<&Image>) -> (Gallery, Vec<Entry>) {
        let mut gallery = Gallery::new(&grey(0.1), reference);
        gallery.entries = [0.2, 0.3].map(|value| Picture::new(&grey(value))).to_vec();
        let [mut good, poor] = [entry(1.0, 40.0), entry(2.0, 30.0)];
        good.name = "good".to_owned();
        (gallery, vec![poor, good])
    }

    #[test]
    fn without_a_reference_the_best_entry_is_the_baseline_and_has_no_map() {
        let (gallery, entries) = gallery(None);
        let baseline = gallery.baseline(&entries).unwrap();
        assert_eq!(baseline, Baseline::Entry("good".to_owned()));
        let mut mapped = Vec::new();
        gallery
            .maps(&baseline, &entries, |i, _| {
                mapped.push(i);
                Ok(())
            })
            .unwrap();
        assert_eq!(mapped, [0]);
    }

    #[test]
    fn an_error_map_is_flip_against_the_reference() {
        let reference = grey(0.25);
        let (gallery, entries) = gallery(Some(&reference));
        let exact = Pair::new(&grey(0.3), &reference, 0).unwrap().flip_map();
        let mut maps = Vec::new();
        gallery
            .maps(&Baseline::Reference, &entries, |_, map| {
                maps.push(map);
                Ok(())
            })
            .unwrap();
        assert_eq!(maps.len(), 2);
        assert!(maps[1].values().iter().zip(exact.values()).all(|(a, b)| (a - b).abs() < 1e-3));
    }

    #[test]
    fn a_crop_has_a_figure_for_each_entry_except_the_baseline() {
        let (gallery, entries) = gallery(None);
        let crops = gallery.crops(&gallery.baseline(&entries).unwrap(), &entries);
        assert!(!crops.is_empty());
        for crop in crops {
            assert!(crop.psnr_db[0].is_some() && crop.psnr_db[1].is_none(), "{crop:?}");
            assert!(crop.pinhole_psnr_db < crop.psnr_db[0], "the pinhole picture is darker still: {crop:?}");
        }
    }
}
