//! `thinlens score`.

use super::Failure;
use super::console::{print, print_json};
use clap::Args;
use std::path::PathBuf;
use thinlens::metrics;
use thinlens::stack::read_picture;

const EXAMPLES: &str = "\
Examples:
  thinlens score out.exr reference.exr
  thinlens score out.exr reference.exr --border 16
  thinlens score out.png reference.png --json";

/// Measure how far a picture is from its reference
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ScoreArgs {
    /// The picture
    image: PathBuf,
    /// What it should be
    reference: PathBuf,
    /// Leave out a frame of this width
    #[arg(long, value_name = "PX", default_value_t = 0, help_heading = "Input")]
    border: usize,
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

pub(super) fn run(args: &ScoreArgs) -> Result<(), Failure> {
    let image = read_picture(&args.image)?;
    let reference = read_picture(&args.reference)?;
    let score = metrics::score(&image, &reference, args.border)?;
    if args.json {
        print_json(&score)?;
    } else {
        let ssim = score.ssim.map_or("picture too small".to_owned(), |ssim| format!("{ssim:.4}"));
        print(&format!(
            "PSNR          {:.2} dB\nSSIM          {ssim}\nrelative MSE  {:.6}\nlog PSNR      {:.2} dB\n",
            score.psnr_db, score.relative_mse, score.log_psnr_db
        ))?;
    }
    Ok(())
}
