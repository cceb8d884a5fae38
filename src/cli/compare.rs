//! `thinlens compare`.

use super::args::{DEFAULT_PROBES, InputArgs, LensArgs, stack_job};
use super::console::{Console, print, print_json};
use super::{Failure, checks};
use clap::Args;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use thinlens::compare::{Comparison, Contender, Entry, mark_front};
use thinlens::error::Error;
use thinlens::metrics::{Pair, check_size};
use thinlens::output::{atomic, png, report};
use thinlens::probes::FEWEST_PROBES;
use thinlens::render::prepare;
use thinlens::stack::{Carry, read_picture};

const EXAMPLES: &str = "\
Examples:
  thinlens compare stack.exr --preset portrait --focus 6
  thinlens compare stack.exr --preset my-lens.toml --methods shear:16,shear:64,gather -o comparison
  thinlens compare stack.exr --preset my-lens.toml --reference lens.exr -o comparison";

/// Compare methods: what each costs, and how wrong it is
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct CompareArgs {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    lens: LensArgs,
    /// NAME, NAME:VIEWS or NAME:KEY=VALUE each; all by default
    ///
    /// A name alone is the method as the job would run it; several settings are joined by +. "all" runs every method at its
    /// steps from rough to fine. It leaves out the reference, accumulate, which is the truth that the sampling error is measured by; name it to have
    /// it measured too.
    #[arg(long, value_name = "A,B:64,C:KEY=VALUE,…", value_delimiter = ',', help_heading = "Method")]
    methods: Vec<String>,
    /// How often each runs; its time is the median
    #[arg(long, value_name = "N", default_value_t = 3, help_heading = "Method",
          value_parser = clap::value_parser!(u16).range(1..))]
    repeats: u16,
    /// Pixels at which the sampling error is measured
    #[arg(long, value_name = "PIXELS", default_value = DEFAULT_PROBES, help_heading = "Method",
          value_parser = clap::value_parser!(u32).range(FEWEST_PROBES as i64..))]
    probes: u32,
    /// A true render with the lens on, for the model error
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    reference: Option<PathBuf>,
    /// Folder for pictures, maps, results.json and .csv
    #[arg(long, short, value_name = "FOLDER", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

pub(super) fn run(args: &CompareArgs, console: &Console) -> Result<(), Failure> {
    let contenders = match args.methods.as_slice() {
        [] => Contender::all(),
        [all_of_them] if all_of_them == "all" => Contender::all(),
        named => named.iter().map(|text| text.parse()).collect::<Result<Vec<Contender>, Error>>()?,
    };
    if let Some(folder) = &args.output {
        checks::folder(folder)?;
        for file in contenders.iter().flat_map(|contender| files(folder, contender)) {
            checks::output(&file, args.input.files().chain(&args.reference))?;
        }
    }
    let reference = args.reference.as_deref().map(read_picture).transpose()?;
    let prepared = prepare(&stack_job(&args.input, &args.lens, Carry::None)?)?;
    console.findings(&prepared.stack.findings);
    if let Some(reference) = &reference {
        check_size(prepared.scene.picture_size(), reference)?;
    }
    let comparison = Comparison {
        prepared: &prepared,
        reference: reference.as_ref(),
        repeats: usize::from(args.repeats),
        probes: args.probes as usize,
    };
    let mut entries = Vec::with_capacity(contenders.len());
    for (i, contender) in contenders.iter().enumerate() {
        console.note(format_args!("{contender} ({} of {})", i + 1, contenders.len()));
        let (entry, image) = comparison.run(contender)?;
        if let Some(folder) = &args.output {
            let [picture, map] = files(folder, contender);
            png::write(&picture, &image, 0.0)?;
            if let Some(reference) = &reference {
                png::write_false_color(&map, &Pair::new(&image, reference, 0)?.flip_map())?;
            }
        }
        entries.push(entry);
    }
    mark_front(&mut entries);
    if let Some(folder) = &args.output {
        write_results(folder, &entries)?;
        console.wrote(folder);
    }
    if args.json {
        print_json(&entries)?;
    } else {
        print(&table(&entries))?;
    }
    Ok(())
}

/// The picture and the error map of a contender.
fn files(folder: &Path, contender: &Contender) -> [PathBuf; 2] {
    let name = contender.to_string().replace([':', '=', '+'], "-");
    [folder.join(format!("{name}.png")), folder.join(format!("{name}-flip.png"))]
}

fn write_results(folder: &Path, entries: &[Entry]) -> Result<(), Error> {
    report::write_json(&folder.join("results.json"), &entries)?;
    atomic::write_text(&folder.join("results.csv"), &csv(entries))
}

/// A figure in `digits` decimals; nothing where there is none.
fn figure(value: Option<f64>, digits: usize) -> String {
    value.map_or(String::new(), |value| format!("{value:.digits$}"))
}

fn csv(entries: &[Entry]) -> String {
    let mut text =
        "name,method,views,cpu_seconds,seconds,runs,sampling_psnr_db,sampling_least_db,sampling_most_db,\
                    model_psnr_db,model_ssim,model_flip,on_front\n"
            .to_owned();
    for entry in entries {
        let Entry { name, method, cpu_seconds, seconds, runs, sampling, model, on_front, .. } = entry;
        let views = entry.views.map_or(String::new(), |views| views.to_string());
        let (least, most) = sampling.interval_db;
        let [psnr, least, most] = [sampling.psnr_db, Some(least), most].map(|db| figure(db, 3));
        let model_psnr = figure(model.map(|score| score.psnr_db), 3);
        let ssim = figure(model.and_then(|score| score.ssim), 5);
        let flip = figure(model.map(|score| score.flip), 5);
        let _ = writeln!(
            text,
            "{name},{method},{views},{cpu_seconds:.4},{seconds:.4},{runs},{psnr},{least},{most},{model_psnr},{ssim},{flip},{on_front}"
        );
    }
    text
}

/// The entries from the quickest to the slowest; a star stands before those that no other beats in both.
fn table(entries: &[Entry]) -> String {
    let mut sorted: Vec<&Entry> = entries.iter().collect();
    sorted.sort_by(|a, b| a.cpu_seconds.total_cmp(&b.cpu_seconds));
    let with_model = entries.iter().any(|entry| entry.model.is_some());
    let mut text = format!("  {:<36}{:>9}{:>9}  {:<22}", "method", "CPU s", "wall s", "sampling error, dB");
    text += if with_model { "model error, dB    SSIM    FLIP\n" } else { "\n" };
    for entry in sorted {
        let star = if entry.on_front { '*' } else { ' ' };
        let (least, most) = entry.sampling.interval_db;
        let most = most.map_or("any".to_owned(), |most| format!("{most:.1}"));
        let sampling = format!("{:>5} ({least:.1} … {most})", figure(entry.sampling.psnr_db, 1));
        let _ = write!(
            text,
            "{star} {:<36}{:>9.3}{:>9.3}  {sampling:<22}",
            entry.name, entry.cpu_seconds, entry.seconds
        );
        if let Some(score) = &entry.model {
            let _ = write!(text, "{:>15.2}{:>8}{:>8.4}", score.psnr_db, figure(score.ssim, 4), score.flip);
        }
        text.push('\n');
    }
    text + "* no other is both quicker and nearer to the truth\n"
}
