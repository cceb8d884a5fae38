//! Fingerprints of the pictures that a build of the program renders: two builds with equal tables render the same bits.
//!
//! `cargo run --release --example fingerprints -- PROGRAM [cpu|gpu …]`
//!
//! PROGRAM renders both samples and five generated stacks with every method on each device (`cpu` by default; `gpu` takes
//! any adapter, including Mesa's lavapipe). A line is stack, method, device and the FNV-1a hash of the picture's 32-bit samples. Run it with
//! two builds and compare the tables with `diff`.

#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "the table is the result; a failed run ends it"
)]

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, WritableImage, read_all_flat_layers_from_file};
use std::path::{Path, PathBuf};
use std::process::Command;

const SIZE: (usize, usize) = (96, 64);

/// One stack to render.
struct Case {
    name: &'static str,
    input: PathBuf,
    flags: Vec<String>,
}

/// One method, as the program lists it.
struct Method {
    name: String,
    samples_the_lens: bool,
    on_gpu: bool,
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let program = PathBuf::from(arguments.next().expect("the program's path is the first argument"));
    let devices: Vec<String> = arguments.collect();
    let devices = if devices.is_empty() { vec!["cpu".to_owned()] } else { devices };
    let folder = tempfile::tempdir().unwrap();
    let methods = methods(&program);
    for case in samples().into_iter().chain(made(folder.path())) {
        for method in &methods {
            for device in devices.iter().filter(|device| *device != "gpu" || method.on_gpu) {
                let views = if method.samples_the_lens { "24" } else { "" };
                let picture = render(
                    &program,
                    &case,
                    &["--method", &method.name, "--views", views, "--device", device],
                );
                println!("{:<14} {:<22} {device:<4} {picture}", case.name, method.name);
            }
        }
        let faulty = "--method shear --views 24 --blades 5 --blade-curvature 0.4 --rotation 10 --squeeze 1.5 --cats-eye 0.9 \
                      --spherical 300 --axial-color 60,-80 --lateral-color 20,-20 --vignetting 1 --border mirror";
        for device in &devices {
            let faulty: Vec<&str> = faulty.split_whitespace().chain(["--device", device]).collect();
            println!(
                "{:<14} {:<22} {device:<4} {}",
                case.name,
                "shear, every fault",
                render(&program, &case, &faulty)
            );
        }
        println!(
            "{:<14} {:<22} cpu  {}",
            case.name,
            "auto, 40 dB",
            render(&program, &case, &["--target-db", "40", "--device", "cpu"])
        );
    }
}

fn methods(program: &Path) -> Vec<Method> {
    let output = Command::new(program).args(["methods", "--json"]).output().unwrap();
    let listed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let method = |method: &serde_json::Value| Method {
        name: method["name"].as_str().unwrap().to_owned(),
        samples_the_lens: method["samples_the_lens"] == true,
        on_gpu: method["runs_on"].as_array().unwrap().iter().any(|device| device == "gpu"),
    };
    listed.as_array().unwrap().iter().map(method).collect()
}

/// The fingerprint of the picture of `case` by `flags`; a flag without a value is left out.
fn render(program: &Path, case: &Case, flags: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("picture.exr");
    let flags = flags.chunks(2).filter(|pair| !pair[1].is_empty()).flatten();
    let run = Command::new(program)
        .args(["render", "--quiet", "--precision", "float", "--carry", "none"])
        .args(["--codec", "none", "-o"])
        .arg(&output)
        .arg(&case.input)
        .args(&case.flags)
        .args(flags)
        .output()
        .unwrap();
    assert!(run.status.success(), "{}: {}", case.name, String::from_utf8_lossy(&run.stderr));
    fingerprint(&output)
}

/// FNV-1a of the samples' bits, channel by channel in the order of the file.
fn fingerprint(picture: &Path) -> String {
    let image = read_all_flat_layers_from_file(picture).unwrap();
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for channel in image.layer_data.iter().flat_map(|layer| &layer.channel_data.list) {
        let FlatSamples::F32(samples) = &channel.sample_data else { panic!("expected 32-bit floats") };
        for byte in samples.iter().flat_map(|sample| sample.to_bits().to_le_bytes()) {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    format!("{hash:016x}")
}

fn samples() -> Vec<Case> {
    let case = |name: &'static str| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name);
        let preset = folder.join("preset.toml").display().to_string();
        Case { name, input: folder.join("stack.exr"), flags: vec!["--preset".to_owned(), preset] }
    };
    ["fence", "table"].map(case).into()
}

/// A fragment of a generated stack: red, green, blue, alpha, depth; premultiplied.
type Fragment = [f32; 5];

/// A generated stack, with `at(x, y, peel)` as its fragments.
struct Made {
    name: &'static str,
    peels: usize,
    flags: &'static str,
    at: fn(usize, usize, usize) -> Fragment,
}

const EMPTY: Fragment = [0.0, 0.0, 0.0, 0.0, 1e10];

/// A fixed pattern of values between 0 and 1.
fn pattern(x: usize, y: usize, k: usize) -> f32 {
    let bits = (x * 73_856_093) ^ (y * 19_349_663) ^ (k * 83_492_791);
    ((bits ^ (bits >> 13)).wrapping_mul(0x5bd1_e995) % 1024) as f32 / 1024.0
}

/// A textured fragment with this alpha at this depth.
fn surface(x: usize, y: usize, k: usize, (alpha, depth): (f32, f32)) -> Fragment {
    let [r, g, b] = [0, 1, 2].map(|c| alpha * (0.2 + 0.7 * pattern(x / 2, y / 2, 3 * k + c)));
    [r, g, b, alpha, depth]
}

const MADE: [Made; 5] = [
    Made {
        name: "bars, lights",
        peels: 2,
        flags: "--focal-length 85 --f-number 1.4 --focus 4",
        at: |x, y, peel| match (x % 24 < 8, peel) {
            (true, 0) => surface(x, y, 0, (1.0, 2.0)),
            (false, 1) => EMPTY,
            _ if (x + 5 * y).is_multiple_of(97) => [40.0, 30.0, 20.0, 1.0, 9.0],
            _ => surface(x, y, 1, (1.0, 3.0 + 0.1 * y as f32)),
        },
    },
    Made {
        name: "translucent",
        peels: 3,
        flags: "--focal-length 50 --f-number 1.2 --focus 3",
        at: |x, y, peel| match peel {
            0 if y % 16 < 10 => {
                surface(x, y, 0, (0.3 + 0.5 * pattern(x / 8, y / 8, 7), 1.5 + 0.01 * x as f32))
            }
            1 if x > 20 => surface(x, y, 1, (0.6, 3.0)),
            2 => surface(x, y, 2, (1.0, 8.0)),
            _ => EMPTY,
        },
    },
    Made {
        name: "beauty and Z",
        peels: 1,
        flags: "--focal-length 85 --f-number 2 --focus 5",
        at: |x, y, _| match (x, y) {
            (0..=9, 0..=9) => EMPTY,
            (30..=50, 15..=45) => surface(x, y, 0, (1.0, 2.5)),
            _ => surface(x, y, 1, (1.0, 4.0 + 0.08 * y as f32)),
        },
    },
    Made {
        name: "supersampled",
        peels: 2,
        flags: "--focal-length 85 --f-number 1.4 --focus 4 --supersample 2",
        at: |x, y, peel| match ((x + y) % 31 < 9, peel) {
            (true, 0) => surface(x, y, 0, (1.0, 2.5)),
            (false, 1) => EMPTY,
            _ => surface(x, y, 1, (1.0, 4.0 + 0.05 * x as f32)),
        },
    },
    Made {
        name: "slopes",
        peels: 4,
        flags: "--focal-length 50 --f-number 1.4 --focus 3 --without fill",
        at: |x, y, peel| match peel {
            0..=2 if (x + 7 * peel) % 19 < 6 => {
                surface(x, y, peel, (1.0, 1.4 + 0.5 * peel as f32 + 0.012 * y as f32))
            }
            3 => surface(x, y, 3, (1.0, 2.5 + 0.05 * y as f32)),
            _ => EMPTY,
        },
    },
];

fn made(folder: &Path) -> Vec<Case> {
    let case = |made: &Made| {
        let input = folder.join(made.name.replace([' ', ','], "")).with_extension("exr");
        write(&input, made);
        Case { name: made.name, input, flags: made.flags.split_whitespace().map(str::to_owned).collect() }
    };
    MADE.iter().map(case).collect()
}

fn write(path: &Path, made: &Made) {
    let (width, height) = SIZE;
    let names = ["Combined.R", "Combined.G", "Combined.B", "Combined.A", "Depth.Z"];
    let channels = (0..made.peels).flat_map(|peel| (0..5).map(move |c| (peel, c)));
    let list = channels
        .map(|(peel, c)| {
            let values = (0..width * height).map(|i| (made.at)(i % width, i / width, peel)[c]).collect();
            AnyChannel::new(format!("Peel{peel}.{}", names[c]).as_str(), FlatSamples::F32(values))
        })
        .collect();
    exr::prelude::Image::from_channels(SIZE, AnyChannels::sort(list)).write().to_file(path).unwrap();
}
