//! The renderer's own anti-aliased picture as the colour of peel 0.
//!
//! Point-sampled peels alias in focus. The beauty of the same frame is an average over each pixel, of what is seen without a lens. So the
//! colour of peel 0 changes by the difference between the beauty and the peels composited: then the composite is the beauty. Where peel 0 is
//! opaque, its colour is that of the beauty.
//!
//! Left to the peels, in proportion:
//!
//! | part | why |
//! | --- | --- |
//! | pixels brighter than white, all from twice white on | a light keeps its exact place and energy |
//! | what is translucent in peel 0 | the colour is that of several peels |
//! | what is empty in peel 0, or outside the beauty | there is no colour to replace |
//!
//! Where the beauty is more transparent than the peels, its colour without alpha counts, by the share that it covers.
//!
//! A beauty that the user names must fit the peels. One that the stack holds itself is left out where it does not.

use super::agreement::differing_share;
use super::layers::Beauty;
use super::windows::place;
use super::{Frame, Peel};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use crate::parallel;

/// Brightness, the largest of red, green and blue, up to which the beauty counts in full, and from which on not at all.
const FADE: [f32; 2] = [1.0, 2.0];

/// Share of the pixels that may differ from the peels without a warning, 0 … 1.
const DIFFERING: f64 = 0.05;

/// Red, green, blue and alpha of a pixel, premultiplied.
type Pixel = [f32; 4];

/// One pixel with its beauty.
#[derive(Debug, Clone, Copy)]
struct Replaced {
    /// Colour of peel 0.
    color: [f32; 3],
    /// How far it is that of the beauty, 0 … 1.
    share: f32,
    /// How far it is not because the pixel is bright, 0 … 1.
    bright: f32,
}

/// Replaces the colour of the first of `peels`, which cover the data window of `frame`, by `beauty`. Says how far by pixel, `None` if
/// nothing is replaced, and in words.
///
/// # Errors
/// For a beauty that the user names: [`crate::error::ErrorKind::Settings`] for peels with several samples a pixel,
/// [`crate::error::ErrorKind::Input`] for a beauty of another frame.
pub(super) fn apply(
    beauty: Beauty,
    peels: &mut [Peel],
    frame: Frame,
    supersample: usize,
) -> Result<(Option<Plane>, Vec<Finding>), Error> {
    match check(&beauty, frame, supersample) {
        Ok(()) => {}
        Err(error) if beauty.is_requested => return Err(error),
        Err(error) => {
            let text = format!("{} is not used: {}", beauty.name, error.on_one_line());
            return Ok((None, vec![Finding { warning: supersample == 1, ..Finding::note("beauty", text) }]));
        }
    }
    let Beauty { name, color, alpha, frame: own, .. } = beauty;
    let [red, green, blue] = color.map(|plane| place(plane, own.data, frame.data, 0.0));
    let planes = [red, green, blue, place(alpha, own.data, frame.data, 0.0)];
    let (width, height) = (frame.data.width, frame.data.height);
    let pixel = |x: usize, y: usize| planes.each_ref().map(|plane| plane.get(x, y));
    let row = |y: usize| (0..width).map(|x| replaced(peels, pixel(x, y), x, y)).collect();
    let rows: Vec<Vec<Replaced>> = parallel::map(height, &row);
    let differing = differing_share(
        [width, height],
        |x, y| color_of(composite(peels, x, y)),
        |x, y| (whole(pixel(x, y), composite(peels, x, y)[3]).1, rows[y][x].share),
    );
    if let Some(peel) = peels.first_mut() {
        for (channel, plane) in peel.color.iter_mut().enumerate() {
            *plane = Plane::from_fn(width, height, |x, y| rows[y][x].color[channel]);
        }
    }
    let findings = [Some(finding(&name, &rows)), doubt(&name, differing)];
    let share = Plane::from_fn(width, height, |x, y| rows[y][x].share);
    Ok((Some(share), findings.into_iter().flatten().collect()))
}

/// Refuses a beauty that is not of the frame, and peels that it is not for.
fn check(beauty: &Beauty, frame: Frame, supersample: usize) -> Result<(), Error> {
    let help = |error: Error, text: &str| if beauty.is_requested { error.help(text) } else { error };
    if supersample > 1 {
        let error = Error::settings("a beauty is for peels with one sample a pixel").with(
            "found",
            format!("{supersample} × {supersample} samples a pixel, and the beauty {}", beauty.name),
        );
        return Err(help(
            error,
            "leave out `beauty`: the samples are averaged over the pixel when they are merged",
        ));
    }
    if beauty.frame.display == frame.display {
        return Ok(());
    }
    let windows = |frame: Frame| format!("data window {}, display window {}", frame.data, frame.display);
    let error = Error::input("the beauty is not of the frame of the peels")
        .with("beauty", format!("{} in {}", windows(beauty.frame), beauty.name))
        .with("peels", windows(frame));
    Err(help(error, "render both with one camera and one display window, or leave out `beauty`"))
}

/// The pixel `x, y` of `peels` with `beauty`.
fn replaced(peels: &[Peel], beauty: Pixel, x: usize, y: usize) -> Replaced {
    let [red, green, blue, alpha] = peels.first().map_or([0.0; 4], |peel| fragment(peel, x, y));
    let color = [red, green, blue];
    let seen = composite(peels, x, y);
    let (covered, beauty) = whole(beauty, seen[3]);
    let brightness = color.into_iter().chain(beauty).fold(0.0, f32::max);
    let dim = ((FADE[1] - brightness) / (FADE[1] - FADE[0])).clamp(0.0, 1.0);
    let share = alpha * covered * dim;
    let channel = |channel: usize| {
        let own: f32 = color[channel];
        // The difference of the first two is exactly 0 where an opaque colour is replaced.
        (own - share * seen[channel] + share * beauty[channel]).max(own.min(0.0))
    };
    Replaced { color: [0, 1, 2].map(channel), share, bright: alpha * covered * (1.0 - dim) }
}

/// The share of what is `seen`, an alpha, that the beauty covers, and the colour of the beauty there.
fn whole(beauty: Pixel, seen: f32) -> (f32, [f32; 3]) {
    let covered = if seen > beauty[3] { beauty[3] / seen } else { 1.0 };
    let whole = if covered > 0.0 { covered.recip() } else { 0.0 };
    (covered, color_of(beauty).map(|value| value * whole))
}

/// The fragment of a peel at `x, y`.
fn fragment(peel: &Peel, x: usize, y: usize) -> Pixel {
    let [red, green, blue] = peel.color.each_ref().map(|plane| plane.get(x, y));
    [red, green, blue, peel.alpha.get(x, y)]
}

/// The fragments of `peels` at `x, y` composited, nearest first.
fn composite(peels: &[Peel], x: usize, y: usize) -> Pixel {
    let (mut sum, mut passing) = ([0.0; 4], 1.0);
    for fragment in peels.iter().map(|peel| fragment(peel, x, y)) {
        sum.iter_mut().zip(fragment).for_each(|(sum, value)| *sum += passing * value);
        passing *= 1.0 - fragment[3];
    }
    sum
}

/// Red, green and blue of a pixel.
fn color_of([red, green, blue, _]: Pixel) -> [f32; 3] {
    [red, green, blue]
}

fn finding(name: &str, rows: &[Vec<Replaced>]) -> Finding {
    let pixels = rows.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let percent = |value: &dyn Fn(&Replaced) -> f32| {
        100.0 * rows.iter().flatten().map(|pixel| f64::from(value(pixel))).sum::<f64>() / pixels
    };
    let (taken, bright) = (percent(&|pixel| pixel.share), percent(&|pixel| pixel.bright));
    let text = format!(
        "peel 0 has the colour of {name} in {taken:.1} % of the picture, an average over the pixel, and its own where either is brighter \
         than white ({bright:.1} %) and where either is translucent or empty ({:.1} %)",
        (100.0 - taken - bright).max(0.0)
    );
    Finding { warning: taken <= 0.0, ..Finding::note("beauty", text) }
}

/// A warning if the beauty differs from the peels in more than [`DIFFERING`] of what it replaces.
fn doubt(name: &str, differing: f64) -> Option<Finding> {
    let text = format!(
        "{name} is brighter or darker than all samples of the peels around in {:.1} % of the pixels: give the beauty of the same frame, \
         camera, exposure and colour space, premultiplied",
        100.0 * differing
    );
    (differing > DIFFERING).then(|| Finding::warning("beauty", text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::Window;

    /// A peel of one row, a colour (grey) and alpha each.
    fn peel(fragments: &[(f32, f32)]) -> Peel {
        let plane = |value: &dyn Fn((f32, f32)) -> f32| {
            Plane::from_fn(fragments.len(), 1, |x, _| value(fragments[x]))
        };
        Peel {
            color: std::array::from_fn(|_| plane(&|(color, _)| color)),
            alpha: plane(&|(_, alpha)| alpha),
            depth: plane(&|_| 1.0),
        }
    }

    fn beauty(pixels: &[(f32, f32)]) -> Beauty {
        let Peel { color, alpha, .. } = peel(pixels);
        let frame = Frame::from_size(pixels.len(), 1);
        Beauty { name: "beauty.exr".to_owned(), color, alpha, frame, is_requested: true }
    }

    /// The colours of peel 0 of `peels` with `pixels` as beauty, and the shares.
    fn applied(mut peels: Vec<Peel>, pixels: &[(f32, f32)]) -> (Vec<f32>, Vec<f32>) {
        let frame = Frame::from_size(pixels.len(), 1);
        let (share, _) = apply(beauty(pixels), &mut peels, frame, 1).unwrap();
        (peels[0].color[0].row(0).to_vec(), share.unwrap().row(0).to_vec())
    }

    #[test]
    fn an_opaque_peel_has_the_colour_of_the_beauty_bit_for_bit() {
        let peels = vec![peel(&[(0.1, 1.0), (0.7, 1.0)]), peel(&[(0.3, 1.0), (0.2, 1.0)])];
        let (colors, shares) = applied(peels, &[(0.437, 1.0), (0.111, 1.0)]);
        assert_eq!((colors, shares), (vec![0.437, 0.111], vec![1.0, 1.0]));
    }

    #[test]
    fn the_composite_of_translucent_peels_moves_towards_the_beauty_by_the_alpha_of_the_first() {
        let (colors, shares) = applied(vec![peel(&[(0.1, 0.5)]), peel(&[(0.6, 1.0)])], &[(0.6, 1.0)]);
        // The composite is 0.1 + 0.5 · 0.6 = 0.4; half of the difference of 0.2 is added.
        assert!((colors[0] - 0.2).abs() < 1e-6 && shares == [0.5], "{colors:?} {shares:?}");
    }

    #[test]
    fn bright_pixels_are_left_to_the_peels_bit_for_bit_and_the_limit_fades() {
        let (colors, shares) = applied(
            vec![peel(&[(50.0, 1.0), (0.2, 1.0), (1.5, 1.0), (1.0, 1.0)])],
            &[(3.0, 1.0), (2.5, 1.0), (0.5, 1.0), (0.5, 1.0)],
        );
        assert_eq!((&colors[..], &shares[..]), (&[50.0, 0.2, 1.0, 0.5][..], &[0.0, 0.0, 0.5, 1.0][..]));
    }

    #[test]
    fn an_empty_sample_stays_empty_and_the_rim_of_a_lone_object_is_not_darkened() {
        // The beauty of an object of colour 0.8 that covers a quarter of either pixel, whose centre only one of them hits.
        let (colors, shares) = applied(vec![peel(&[(0.0, 0.0), (0.8, 1.0)])], &[(0.2, 0.25), (0.2, 0.25)]);
        assert_eq!((colors[0], &shares[..]), (0.0, &[0.0, 0.25][..]));
        assert!((colors[1] - 0.8).abs() < 1e-6, "{colors:?}");
    }

    #[test]
    fn outside_its_data_window_the_peels_keep_their_colour() {
        let window = Window { x: 1, y: 0, width: 1, height: 1 };
        let mut peels = vec![peel(&[(0.1, 1.0), (0.2, 1.0), (0.3, 1.0)])];
        let frame = Frame::from_size(3, 1);
        let crop = Beauty { frame: Frame { data: window, ..frame }, ..beauty(&[(0.9, 1.0)]) };
        let (share, findings) = apply(crop, &mut peels, frame, 1).unwrap();
        assert_eq!(peels[0].color[0].row(0), [0.1, 0.9, 0.3]);
        assert_eq!(share.unwrap().row(0), [0.0, 1.0, 0.0]);
        assert!(findings[0].text.contains("in 33.3 % of the picture"), "{findings:?}");
    }

    #[test]
    fn overscan_of_the_beauty_that_the_peels_lack_is_left_out() {
        let mut peels = vec![peel(&[(0.1, 1.0), (0.2, 1.0)])];
        let frame = Frame::from_size(2, 1);
        let data = Window { x: -1, y: 0, width: 4, height: 1 };
        let wide = Beauty {
            frame: Frame { data, ..frame },
            ..beauty(&[(0.5, 1.0), (0.15, 1.0), (0.25, 1.0), (0.6, 1.0)])
        };
        apply(wide, &mut peels, frame, 1).unwrap();
        assert_eq!(peels[0].color[0].row(0), [0.15, 0.25]);
    }

    #[test]
    fn a_beauty_that_shows_something_else_or_nothing_is_taken_with_a_warning() {
        let warned = |pixel: (f32, f32)| {
            let mut peels = [peel(&[(0.4, 1.0); 9])];
            let (_, findings) = apply(beauty(&[pixel; 9]), &mut peels, Frame::from_size(9, 1), 1).unwrap();
            findings.iter().filter(|finding| finding.warning).map(|finding| finding.text.clone()).collect()
        };
        let warnings: [Vec<String>; 3] = [(0.41, 1.0), (0.1, 1.0), (0.0, 0.0)].map(warned);
        assert!(warnings[0].is_empty(), "{warnings:?}");
        assert!(warnings[1][0].contains("in 100.0 % of the pixels"), "{warnings:?}");
        assert!(warnings[2][0].contains("in 0.0 % of the picture"), "{warnings:?}");
    }

    #[test]
    fn a_beauty_of_another_frame_and_of_several_samples_a_pixel_is_refused_with_the_way_out() {
        let refused = |beauty: Beauty, supersample| {
            let peels = &mut [peel(&[(0.1, 1.0); 4])];
            apply(beauty, peels, Frame::from_size(4, 1), supersample).unwrap_err().to_string()
        };
        let text = refused(beauty(&[(0.5, 1.0); 2]), 1);
        assert!(text.contains("not of the frame") && text.contains("2×1") && text.contains("4×1"), "{text}");
        let text = refused(beauty(&[(0.5, 1.0); 4]), 2);
        assert!(text.contains("one sample a pixel") && text.contains("leave out `beauty`"), "{text}");
    }

    #[test]
    fn a_beauty_in_the_stack_that_does_not_fit_is_left_out_and_said_so() {
        for (pixels, supersample) in [(2, 1), (4, 2)] {
            let mut peels = [peel(&[(0.1, 1.0); 4])];
            let own = Beauty { is_requested: false, ..beauty(&vec![(0.5, 1.0); pixels]) };
            let (share, findings) = apply(own, &mut peels, Frame::from_size(4, 1), supersample).unwrap();
            assert_eq!((share, peels[0].color[0].row(0)), (None, &[0.1; 4][..]));
            let [Finding { text, warning, .. }] = &findings[..] else { panic!("{findings:?}") };
            assert!(text.contains("is not used") && !text.contains("leave out"), "{text}");
            assert_eq!(*warning, supersample == 1, "averaged samples have their beauty already");
        }
    }
}
