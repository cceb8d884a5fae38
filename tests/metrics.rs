//! The figures against scikit-image: expected values were computed there, from the same pictures, in double
//! precision (SSIM: `structural_similarity(gaussian_weights=True, sigma=1.5, use_sample_covariance=False)`). FLIP against
//! its authors' flip-evaluator 1.7, with its defaults.

#![expect(clippy::unwrap_used, reason = "a fixture that fails, fails its test")]

use exr::prelude::{ReadChannels as _, ReadLayers as _, read};
use std::path::Path;
use thinlens::image::Image;
use thinlens::metrics::{Pair, Score};

/// Agreement of decibels and of the other figures (relative).
const DECIBELS: f64 = 0.01;
const SHARE: f64 = 1e-4;

/// Agreement of FLIP, whose evaluator works in single precision.
const FLIP: f64 = 1e-4;

struct Expected {
    border: usize,
    psnr_db: f64,
    ssim: f64,
    flip: f64,
    hdr_flip: f64,
    relative_mse: f64,
    log_psnr_db: f64,
}

fn assert_agrees(image: &Image, reference: &Image, expected: &Expected) {
    let pair = Pair::new(image, reference, expected.border).unwrap();
    let Score { psnr_db, ssim, flip, relative_mse, log_psnr_db, .. } = pair.score();
    let hdr_flip = pair.hdr_flip();
    assert!((psnr_db - expected.psnr_db).abs() < DECIBELS, "PSNR {psnr_db}");
    assert!((ssim.unwrap() - expected.ssim).abs() < SHARE, "SSIM {ssim:?}");
    assert!((flip - expected.flip).abs() < FLIP, "FLIP {flip}");
    assert!((hdr_flip - expected.hdr_flip).abs() < FLIP, "HDR-FLIP {hdr_flip}");
    assert!((relative_mse / expected.relative_mse - 1.0).abs() < SHARE, "relative MSE {relative_mse}");
    assert!((log_psnr_db - expected.log_psnr_db).abs() < DECIBELS, "log PSNR {log_psnr_db}");
}

/// Noise, bright lines and negative values; `k` = 0 is the reference.
fn noise(k: usize) -> Image {
    Image::from_fn(200, 140, |x, y| {
        let channel = |c: usize| {
            let line = (x + 2 * y + c * 7).is_multiple_of(41);
            let grain = ((x * (3 + c) + y * (5 + k) + x * y * (1 + c)) % 97) as f32 / 64.0 - 0.125;
            match (k, line) {
                (0, true) => 8.0 + c as f32,
                (0, false) => grain,
                _ => (if line { 6.0 } else { grain }) * 0.75 + (x * y % 13) as f32 / 32.0,
            }
        };
        [channel(0), channel(1), channel(2), 1.0]
    })
}

/// Waves, with faint grain on top for `k` = 1.
fn waves(k: usize) -> Image {
    Image::from_fn(200, 140, |x, y| {
        let grain = (k * ((x * 7 + y * 3) % 16)) as f32 / 128.0;
        let channel = |c: usize| ((x * x * (2 + c) + y * y * 3) % 256) as f32 / 256.0 + grain;
        [channel(0), channel(1), channel(2), 1.0]
    })
}

/// The colour of a sample picture, whatever group its channels are in.
fn sample(name: &str) -> Image {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name);
    let picture = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .unwrap();
    let layer = picture.layer_data;
    let mut image = Image::transparent(layer.size.width(), layer.size.height());
    for (plane, suffix) in image.planes.iter_mut().zip(["R", "G", "B"]) {
        let mut channels = layer.channel_data.list.iter();
        let channel = channels.find(|channel| channel.name.to_string().ends_with(suffix)).unwrap();
        let values = channel.sample_data.values_as_f32();
        plane.values_mut().iter_mut().zip(values).for_each(|(out, value)| *out = value);
    }
    image
}

#[test]
fn noise_scores_as_in_scikit_image() {
    let (image, reference) = (noise(1), noise(0));
    let whole = Expected {
        border: 0,
        psnr_db: 8.268_431,
        ssim: 0.044_438_7,
        flip: 0.341208,
        hdr_flip: 0.338959,
        relative_mse: 6.119_428_6,
        log_psnr_db: 16.593_525,
    };
    let inner = Expected {
        border: 17,
        psnr_db: 8.125_775,
        ssim: 0.023_131_9,
        flip: 0.339589,
        hdr_flip: 0.339233,
        relative_mse: 7.002_027_0,
        log_psnr_db: 16.482_727,
    };
    assert_agrees(&image, &reference, &whole);
    assert_agrees(&image, &reference, &inner);
}

#[test]
fn waves_score_as_in_scikit_image() {
    let (image, reference) = (waves(1), waves(0));
    let whole = Expected {
        border: 0,
        psnr_db: 23.834_449,
        ssim: 0.976_958_75,
        flip: 0.153488,
        hdr_flip: 0.162569,
        relative_mse: 0.070_018_604,
        log_psnr_db: 23.326_368,
    };
    let inner = Expected {
        border: 17,
        psnr_db: 23.949_785,
        ssim: 0.977_609_9,
        flip: 0.152131,
        hdr_flip: 0.159196,
        relative_mse: 0.067_864_195,
        log_psnr_db: 23.368_309,
    };
    assert_agrees(&image, &reference, &whole);
    assert_agrees(&image, &reference, &inner);
}

#[test]
fn a_pinhole_render_scores_against_the_true_lens_as_in_scikit_image() {
    let (image, reference) = (sample("fence/pinhole.exr"), sample("fence/reference.exr"));
    let whole = Expected {
        border: 0,
        psnr_db: 19.063_963,
        ssim: 0.492_939_99,
        flip: 0.377383,
        hdr_flip: 0.347224,
        relative_mse: 0.138_397_34,
        log_psnr_db: 16.354_79,
    };
    let inner = Expected {
        border: 17,
        psnr_db: 19.130_059,
        ssim: 0.488_200_8,
        flip: 0.375219,
        hdr_flip: 0.341389,
        relative_mse: 0.134_402_33,
        log_psnr_db: 16.507_748,
    };
    assert_agrees(&image, &reference, &whole);
    assert_agrees(&image, &reference, &inner);
}
