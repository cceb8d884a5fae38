//! `thinlens score`.

use super::args::read_input;
use super::checks;
use super::console::{Console, print, print_json};
use super::failure::Failure;
use clap::Args;
use std::collections::BTreeSet;
use std::path::PathBuf;
use thinlens::error::Error;
use thinlens::image::Image;
use thinlens::memory::parse_bytes;
use thinlens::metrics::{Pair, Score};
use thinlens::output::{atomic, png};
use thinlens::stack::{Window, is_read_once};

const EXAMPLES: &str = "\
Examples:
  thinlens score out.exr reference.exr --border 16
  thinlens score out.png reference.png --json
  thinlens score out.exr reference.exr --hdr-flip --map difference.png";

/// Measure the error of a picture against a reference
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ScoreArgs {
    /// Picture to measure; - is stdin
    image: PathBuf,
    /// Reference picture
    reference: PathBuf,
    /// Width of a border that is left out
    #[arg(long, value_name = "PX", default_value_t = 0, help_heading = "Input")]
    border: usize,
    /// Memory of a decoded picture; default: half of what there is
    #[arg(long, visible_alias = "max-memory", value_name = "SIZE", value_parser = parse_bytes, help_heading = "Input")]
    memory: Option<u64>,
    /// Also measure HDR-FLIP, over all exposures
    #[arg(long, help_heading = "Output")]
    hdr_flip: bool,
    /// Write FLIP at each pixel as a false-colour PNG
    #[arg(long, value_name = "FILE.png", help_heading = "Output")]
    map: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

/// The content of `--json`.
#[derive(Debug, serde::Serialize)]
struct ScoreReport {
    #[serde(flatten)]
    score: Score,
    hdr_flip: Option<f64>,
    /// Pixels of which either picture has no number: they count as black against white.
    broken_pixels: usize,
    /// The part of the picture that is compared, in pixels of its data window.
    compared: Window,
}

pub(super) fn run(args: &ScoreArgs) -> Result<(), Failure> {
    if let Some(map) = &args.map {
        checks::output(map, [&args.image, &args.reference].into_iter())?;
    }
    if args.image == args.reference && is_read_once(&args.image) {
        return Err(Error::settings("a picture from a pipe cannot be compared with itself")
            .in_file(&args.image)
            .help("name two pictures")
            .into());
    }
    let image = read_input(&args.image, args.memory)?;
    let reference = read_input(&args.reference, args.memory)?;
    let parts = image.picture.frame.shared_with(&reference.picture.frame)?;
    let console = Console::new(false);
    console.compared(parts, [&image.picture.frame, &reference.picture.frame]);
    console.replaced(&args.image, image.replaced);
    console.replaced(&args.reference, reference.replaced);
    let mut pictures = [image.picture.part(parts[0]), reference.picture.part(parts[1])];
    let broken = mark_broken(&mut pictures, parts, [image.broken, reference.broken]);
    let [image, reference] = pictures;
    let pair = Pair::new(&image, &reference, args.border)?;
    let hdr_flip = args.hdr_flip.then(|| pair.hdr_flip());
    let report = ScoreReport { score: pair.score(), hdr_flip, broken_pixels: broken, compared: parts[0] };
    if let Some(map) = &args.map {
        png::write_false_color(map, &pair.flip_map())?;
        Console::new(false).wrote(map);
    }
    if args.json {
        print_json(&report)?;
    } else {
        print(&in_words(&report))?;
    }
    Ok(())
}

/// Makes the pixels of two `pictures` that are `broken` in either differ as black from white, and counts them. `parts` are the windows of the
/// pictures in their data windows, which have the broken pixels.
fn mark_broken(pictures: &mut [Image; 2], parts: [Window; 2], broken: [Vec<[usize; 2]>; 2]) -> usize {
    let within = |part: Window, [x, y]: [usize; 2]| {
        let x = x.checked_sub(part.x.unsigned_abs() as usize).filter(|x| *x < part.width)?;
        let y = y.checked_sub(part.y.unsigned_abs() as usize).filter(|y| *y < part.height)?;
        Some([x, y])
    };
    let places = parts.into_iter().zip(broken).flat_map(|(part, broken)| {
        broken.into_iter().filter_map(move |place| within(part, place)).collect::<Vec<_>>()
    });
    let places: BTreeSet<[usize; 2]> = places.collect();
    for &[x, y] in &places {
        for (picture, value) in pictures.iter_mut().zip([0.0, 1.0]) {
            picture.planes.iter_mut().for_each(|plane| plane.set(x, y, value));
        }
    }
    places.len()
}

impl ScoreArgs {
    /// The folders that temporary files are made in.
    pub(super) fn folders(&self) -> Vec<PathBuf> {
        self.map.iter().filter_map(|file| atomic::temporary_folder(file)).collect()
    }
}

fn in_words(ScoreReport { score, hdr_flip, .. }: &ScoreReport) -> String {
    let ssim = score.ssim.map_or("picture too small".to_owned(), |ssim| format!("{ssim:.4}"));
    let hdr_flip = hdr_flip.map(|value| format!("HDR-FLIP      {value:.4}\n")).unwrap_or_default();
    format!(
        "PSNR          {:.2} dB\nSSIM          {ssim}\nFLIP          {:.4}\n{hdr_flip}relative MSE  {:.6}\nlog PSNR      {:.2} \
         dB\n",
        score.psnr_db, score.flip, score.relative_mse, score.log_psnr_db
    )
}
