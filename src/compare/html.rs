//! The comparison as one self-contained page: no network, no other file.
//!
//! The page is `report/page.html` with style, script and figures inserted. The figures are one block of JSON, from
//! which the script builds chart, table and pictures. Pictures are data URIs: whole pictures at most [`MAX_WIDTH_PX`] wide as
//! JPEG, error maps at most [`MAX_MAP_WIDTH_PX`] wide as JPEG or PNG, crops as lossless PNG. Cost: one second of CPU time per entry at
//! 1080p, FLIP and the other files included.

use super::gallery::Gallery;
use super::picture::{Picture, Square, shrunk};
use super::{Crop, Results};
use crate::error::Error;
use crate::image::Plane;
use crate::methods::METHODS;
use crate::output::data_uri::{self, Rgb8};
use crate::output::png;
use crate::parallel;
use serde::Serialize;

/// Maximum width of whole pictures on the page; the folder has them at full size.
const MAX_WIDTH_PX: usize = 1280;

/// Maximum width of error maps on the page: they show where errors are, and maps of noise dominate the size of the page.
const MAX_MAP_WIDTH_PX: usize = 960;

/// Number of colours of the error maps' scale.
const SCALE_STEPS: usize = 17;

const PAGE: &str = include_str!("report/page.html");
const STYLE: &str = include_str!("report/style.css");
const SCRIPT: &str = concat!(
    include_str!("report/data.js"),
    include_str!("report/marks.js"),
    include_str!("report/chart.js"),
    include_str!("report/table.js"),
    include_str!("report/pictures.js"),
    include_str!("report/crops.js"),
    include_str!("report/main.js"),
);

/// The pictures of the page, as data URIs.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub(super) struct Assets {
    pinhole: String,
    reference: Option<String>,
    entries: Vec<String>,
    maps: Vec<Option<String>>,
    crops: Vec<CropAssets>,
}

/// One crop of every picture.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct CropAssets {
    pinhole: String,
    reference: Option<String>,
    entries: Vec<String>,
}

/// The data that the script reads.
#[derive(Serialize)]
struct Content<'a> {
    results: &'a Results,
    assets: &'a Assets,
    /// Names of all methods: the index in this list determines colour and mark, so that they are the same in every report.
    methods: Vec<&'static str>,
    /// Colours of the error maps' scale, from 0 to 1.
    scale: Vec<String>,
}

impl Assets {
    /// The pictures and `crops` of `gallery`, without error maps.
    ///
    /// # Errors
    /// Pictures that cannot be encoded.
    pub(super) fn new(gallery: &Gallery, crops: &[Crop]) -> Result<Self, Error> {
        let entries = parallel::map(gallery.entries.len(), &|entry| whole(&gallery.entries[entry]));
        let crops = parallel::map(crops.len(), &|crop| CropAssets::new(gallery, &crops[crop]));
        Ok(Self {
            pinhole: whole(&gallery.pinhole)?,
            reference: gallery.reference.as_ref().map(whole).transpose()?,
            entries: entries.into_iter().collect::<Result<_, _>>()?,
            maps: vec![None; gallery.entries.len()],
            crops: crops.into_iter().collect::<Result<_, _>>()?,
        })
    }

    /// Sets the error map of entry `i`.
    ///
    /// # Errors
    /// A map that cannot be encoded.
    pub(super) fn set_map(&mut self, i: usize, map: Plane) -> Result<(), Error> {
        let map = shrunk(map, MAX_MAP_WIDTH_PX);
        let picture = Rgb8 { width: map.width(), height: map.height(), bytes: png::false_color(&map) };
        self.maps[i] = Some(data_uri::smaller(&picture)?);
        Ok(())
    }
}

impl CropAssets {
    fn new(gallery: &Gallery, crop: &Crop) -> Result<Self, Error> {
        let square = Square { x: crop.x, y: crop.y, side: crop.side_px };
        let cut = |picture: &Picture| data_uri::png(&picture.crop(square).to_rgb8());
        Ok(Self {
            pinhole: cut(&gallery.pinhole)?,
            reference: gallery.reference.as_ref().map(cut).transpose()?,
            entries: gallery.entries.iter().map(cut).collect::<Result<_, _>>()?,
        })
    }
}

fn whole(picture: &Picture) -> Result<String, Error> {
    data_uri::jpeg(&picture.clone().at_most(MAX_WIDTH_PX).to_rgb8())
}

/// The page about `results`, with the pictures `assets`.
///
/// # Errors
/// Results that cannot be written as JSON.
pub(super) fn page(results: &Results, assets: &Assets) -> Result<String, Error> {
    let methods = METHODS.iter().map(|method| method.info().name).collect();
    let content = json(&Content { results, assets, methods, scale: scale() })?;
    let page = PAGE.replace("/*STYLE*/", STYLE).replace("/*SCRIPT*/", SCRIPT);
    // Last, so that no text in the figures is mistaken for a placeholder.
    Ok(page.replacen("/*CONTENT*/", &content, 1))
}

/// `value` as JSON for a script element. `<` is escaped, so that the text contains neither the element's end tag nor a comment.
fn json(value: &impl Serialize) -> Result<String, Error> {
    let text = serde_json::to_string(value)
        .map_err(|cause| Error::output("the results cannot be written as JSON").caused_by(cause))?;
    Ok(text.replace('<', "\\u003c"))
}

fn scale() -> Vec<String> {
    let ramp = Plane::from_fn(SCALE_STEPS, 1, |x, _| x as f32 / (SCALE_STEPS - 1) as f32);
    let colors = png::false_color(&ramp);
    colors.chunks_exact(3).map(|rgb| format!("#{:02x}{:02x}{:02x}", rgb[0], rgb[1], rgb[2])).collect()
}

#[cfg(test)]
mod tests {
    use super::super::Entry;
    use super::super::tests::{entry, results};
    use super::*;

    #[test]
    fn a_file_name_cannot_end_the_block_of_figures() {
        let nasty = "</script><script>alert(1)</script><!-- /*CONTENT*/ /*SCRIPT*/ & \u{2028}.exr";
        let mut results = results(vec![Entry { command: nasty.to_owned(), ..entry(1.0, 30.0) }]);
        results.input = vec![nasty.to_owned()];
        let page = page(&results, &Assets::default()).unwrap();
        assert!(!page.contains("alert(1)</script"), "the name stands in the page as it is");
        let (_, rest) = page.split_once("<script type=\"application/json\" id=\"content\">").unwrap();
        let (block, _) = rest.split_once("</script>").unwrap();
        let content: serde_json::Value = serde_json::from_str(block).unwrap();
        assert_eq!(content["results"]["input"][0], nasty);
        assert_eq!(content["results"]["entries"][0]["command"], nasty);
    }

    #[test]
    fn the_page_loads_nothing_from_outside() {
        let page = page(&results(Vec::new()), &Assets::default()).unwrap();
        assert!(page.contains("default-src 'none'"), "{page}");
        for outside in ["src=\"http", "href=\"http", "url(http", "@import", "fetch(", "XMLHttpRequest"] {
            assert!(!page.contains(outside), "{outside}");
        }
        for place in ["/*STYLE*/", "/*SCRIPT*/", "/*CONTENT*/"] {
            assert!(!page.contains(place), "{place} was not filled");
        }
    }

    #[test]
    fn the_scale_runs_from_black_to_pale_yellow() {
        let scale = scale();
        assert_eq!((scale.len(), scale[0].as_str(), scale[16].as_str()), (17, "#000004", "#fcfdbf"));
    }
}
