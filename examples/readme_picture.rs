//! The picture of the README: the terrace sample without a lens, by thinlens, and by a renderer with the lens on. Below are close-ups of
//! beauty + Z, of peels, and of the renderer's picture.
//!
//! `cargo run --release --example readme_picture -- docs/terrace.png`

use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::image::Image;
use thinlens::output::png;
use thinlens::render::{Job, NamedPreset, render};
use thinlens::settings::{Preset, Values};
use thinlens::stack::{Source, read_picture};

/// Folder of the sample.
const SAMPLE: &str = "samples/terrace";

/// Left, top, width and height in pixels of the close-ups: twig and lights.
const CROP: [usize; 4] = [213, 0, 106, 60];

/// Magnification of the close-ups.
const ZOOM: usize = 3;

/// Width in pixels of the strip between pictures.
const GAP_PX: usize = 8;

/// Brightness of that strip, scene-linear.
const GAP: f32 = 1.0;

/// Exposure in stops; the scene is lit by a low sun and is dark without it.
const EXPOSURE: f32 = 0.5;

fn main() -> Result<(), Error> {
    let output = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "docs/terrace.png".to_owned()));
    let pinhole = picture("stack.exr", Some(f32::INFINITY))?;
    let beauty_and_z = picture("pinhole.exr", None)?;
    let peels = picture("stack.exr", None)?;
    let reference = read_picture(&Path::new(SAMPLE).join("reference.exr"))?;
    let close_ups = [&beauty_and_z, &peels, &reference].map(close_up);
    let rows = [row([&pinhole, &peels, &reference]), row([&close_ups[0], &close_ups[1], &close_ups[2]])];
    png::write(&output, &column(&rows), EXPOSURE)
}

/// `input` of the sample, rendered with its lens, or with that lens at another f-number.
fn picture(input: &str, f_number: Option<f32>) -> Result<Image, Error> {
    let preset = format!("{SAMPLE}/preset.toml");
    let job = Job {
        sources: vec![Source::File(Path::new(SAMPLE).join(input))],
        preset: Some(NamedPreset { preset: Preset::load(&preset)?, name: preset }),
        flags: Values { f_number, ..Values::default() },
        ..Job::default()
    };
    Ok(render(&job, &|_| {})?.image)
}

/// [`CROP`] of `image`, enlarged without interpolation.
fn close_up(image: &Image) -> Image {
    let [left, top, width, height] = CROP;
    Image::from_fn(width * ZOOM, height * ZOOM, |x, y| image.pixel(left + x / ZOOM, top + y / ZOOM))
}

/// `images` from left to right, each in a cell as wide as the first.
fn row(images: [&Image; 3]) -> Image {
    let [width, height] = [images[0].width(), images[0].height()];
    let cell = width + GAP_PX;
    Image::from_fn(3 * width + 2 * GAP_PX, height, |x, y| {
        if x % cell < width { opaque(images[x / cell].pixel(x % cell, y)) } else { [GAP, GAP, GAP, 1.0] }
    })
}

/// The two `rows`, one above the other and centred.
fn column([above, below]: &[Image; 2]) -> Image {
    let [width, height] = [above.width(), above.height()];
    let left = (width - below.width()) / 2;
    Image::from_fn(width, height + GAP_PX + below.height(), |x, y| {
        if y < height {
            above.pixel(x, y)
        } else if y >= height + GAP_PX && (left..left + below.width()).contains(&x) {
            below.pixel(x - left, y - height - GAP_PX)
        } else {
            [GAP, GAP, GAP, 1.0]
        }
    })
}

/// A pixel over black.
fn opaque([r, g, b, _]: [f32; 4]) -> [f32; 4] {
    [r, g, b, 1.0]
}
