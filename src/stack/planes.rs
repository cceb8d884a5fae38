//! A [`Stack`] of planes in memory: checked and understood as one from files is.

use super::guard::COORDINATE_LIMIT;
use super::layers::{Layer, Layers};
use super::options::ReadOptions;
use super::sanitise::{self, Replaced};
use super::{ColorRange, Frame, Peel, Precision, Stack, Window, read};
use crate::error::Error;
use crate::image::Plane;
use std::path::PathBuf;

impl Stack {
    /// A stack of `peels`, nearest first, all of the size of the frame's data window.
    ///
    /// Of `options` count how depth is written ([`ReadOptions::convention`], planar when `None`), the samples a picture pixel
    /// ([`ReadOptions::supersample`]) and how colour and alpha are combined ([`ReadOptions::alpha`], premultiplied when `None`); the rest is about files. As with a file, NaN and infinite colours are replaced, alpha is
    /// clamped to 0 … 1, what the fragments stand for is recognised by their alpha and depth, and [`Stack::findings`] say what
    /// was concluded.
    ///
    /// ```
    /// use thinlens::image::Plane;
    /// use thinlens::stack::{Frame, Peel, ReadOptions, Stack};
    ///
    /// let grey = Plane::filled(64, 36, 0.5);
    /// let peel = Peel { color: [grey.clone(), grey.clone(), grey], alpha: Plane::filled(64, 36, 1.0), depth: Plane::filled(64, 36, 4.0) };
    /// let stack = Stack::from_peels(vec![peel], Frame::from_size(64, 36), &ReadOptions::default())?;
    /// assert_eq!(stack.peels.len(), 1);
    /// # Ok::<(), thinlens::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// No peel; a plane that is not of the data window's size; a window without pixels or beyond ±2³⁰; samples a pixel that do not
    /// divide the windows; no depth at all.
    pub fn from_peels(peels: Vec<Peel>, frame: Frame, options: &ReadOptions) -> Result<Self, Error> {
        if peels.is_empty() {
            return Err(Error::input("there is no peel").help("give at least one picture with its depth"));
        }
        check_window("data", frame.data)?;
        check_window("display", frame.display)?;
        peels.iter().enumerate().try_for_each(|(i, peel)| check_sizes(i, peel, frame.data))?;
        let mut replaced = Replaced::default();
        let layer = |(i, peel)| layer(i, peel, frame.data, &mut replaced).premultiplied(options.alpha);
        let layers = Layers {
            name: PathBuf::from("memory"),
            peels: peels.into_iter().enumerate().map(layer).collect(),
            is_merged: false,
            beauty: None,
            frame,
            precision: Precision::Float,
            color_range: ColorRange::Unbounded,
            attributes: Vec::new(),
            channels: Vec::new(),
            cryptomattes: Vec::new(),
            findings: Vec::new(),
            is_numbered: false,
            replaced,
        };
        read::finish(layers, options)
    }
}

/// Refuses a window whose pixels cannot be counted.
fn check_window(which: &str, window: Window) -> Result<(), Error> {
    let within = |start: i32, size: usize| {
        let end = i64::try_from(size).map(|size| i64::from(start).saturating_add(size));
        i64::from(start) >= -COORDINATE_LIMIT && end.is_ok_and(|end| end <= COORDINATE_LIMIT)
    };
    let has_pixels = window.width > 0 && window.height > 0;
    if has_pixels && within(window.x, window.width) && within(window.y, window.height) {
        return Ok(());
    }
    Err(Error::input(format!("the {which} window has no pixels, or lies too far out"))
        .with("found", window.to_string())
        .help("give windows of at least one pixel, with coordinates between -2^30 and 2^30"))
}

/// Refuses a peel with a plane that does not fill the data window.
fn check_sizes(i: usize, peel: &Peel, data: Window) -> Result<(), Error> {
    let [red, green, blue] = &peel.color;
    let planes =
        [("red", red), ("green", green), ("blue", blue), ("alpha", &peel.alpha), ("depth", &peel.depth)];
    let fits = |plane: &Plane| (plane.width(), plane.height()) == (data.width, data.height);
    match planes.into_iter().find(|(_, plane)| !fits(plane)) {
        None => Ok(()),
        Some((name, plane)) => {
            Err(Error::input(format!("the {name} plane of peel {i} is not of the data window's size"))
                .with("found", format!("{}×{} values", plane.width(), plane.height()))
                .with("data window", data.to_string())
                .help("give every plane as many values as the data window has pixels"))
        }
    }
}

/// Peel `i` as a reader would hand it on.
fn layer(i: usize, peel: Peel, window: Window, replaced: &mut Replaced) -> Layer {
    let Peel { mut color, mut alpha, depth } = peel;
    color.iter_mut().for_each(|plane| sanitise::color(plane.values_mut(), replaced));
    sanitise::alpha(alpha.values_mut(), replaced);
    Layer {
        color,
        alpha,
        depth: Some(depth),
        window,
        prefix: i.to_string(),
        depth_channel: String::new(),
        found: "planes in memory".to_owned(),
        shading: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::DepthConvention;
    use crate::stack::Antialiasing;

    fn peel(width: usize, height: usize, color: f32, depth: f32) -> Peel {
        let plane = |value| Plane::filled(width, height, value);
        Peel { color: [plane(color), plane(color), plane(color)], alpha: plane(1.0), depth: plane(depth) }
    }

    fn refused(peels: Vec<Peel>, frame: Frame) -> String {
        Stack::from_peels(peels, frame, &ReadOptions::default()).unwrap_err().to_string()
    }

    #[test]
    fn planes_in_memory_are_understood_as_a_files_are() {
        let options = ReadOptions { convention: Some(DepthConvention::Ray), ..ReadOptions::default() };
        let peels = vec![peel(2, 1, f32::NAN, 1.0), peel(2, 1, 0.5, 3.0)];
        let stack = Stack::from_peels(peels, Frame::from_size(2, 1), &options).unwrap();
        assert_eq!((stack.kind, stack.convention), (None, DepthConvention::Ray));
        assert_eq!(stack.antialiasing, Antialiasing::POINT_SAMPLES);
        assert_eq!(stack.peels[0].color[0].values(), [0.0, 0.0], "NaN is replaced");
        assert!(stack.findings.iter().any(|finding| finding.text.contains("6 colour values were NaN")));
    }

    #[test]
    fn planes_that_make_no_stack_say_which() {
        assert!(refused(vec![], Frame::from_size(2, 1)).contains("no peel"));
        let text = refused(vec![peel(2, 1, 0.5, 1.0), peel(1, 2, 0.5, 1.0)], Frame::from_size(2, 1));
        assert!(text.contains("red plane of peel 1") && text.contains("1×2 values"), "{text}");
        let empty = Frame { display: Window { x: 0, y: 0, width: 0, height: 1 }, ..Frame::from_size(2, 1) };
        assert!(refused(vec![peel(2, 1, 0.5, 1.0)], empty).contains("display window"));
        let far = Window { x: i32::MAX, y: 0, width: 2, height: 1 };
        assert!(
            refused(vec![peel(2, 1, 0.5, 1.0)], Frame { data: far, ..Frame::from_size(2, 1) })
                .contains("data window")
        );
        assert!(refused(vec![peel(2, 1, 0.5, f32::NAN)], Frame::from_size(2, 1)).contains("NaN everywhere"));
    }
}
