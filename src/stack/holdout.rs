//! Holdouts: objects that take light away where they lie and are not seen themselves, so that an element can be put behind them later.
//!
//! The fragments of a holdout are merged into the stack by depth, black. They hide what is behind them, along each lens ray, as the objects
//! themselves would. The alpha of the picture counts what is seen only: [`Stack::shown`] has, for every fragment, the alpha that it shows.
//! It is merged as the colours are, so that both have the same fragments in the same places.

use super::kind::{self, Announced};
use super::options::{Carry, ReadOptions};
use super::{Peel, Source, Stack, Window, guard, merge_files, shading, windows};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use exr::image::FlatSamples;

/// A reader of stacks.
type Read<'a> = &'a dyn Fn(&[Source], &ReadOptions) -> Result<Stack, Error>;

/// `stack` with the fragments of the holdout in `source`, read by `read`.
///
/// # Errors
/// Those of reading; another frame, depth convention or number of samples a pixel; more memory than allowed.
pub(super) fn apply(
    stack: Stack,
    source: &Source,
    options: &ReadOptions,
    read: Read<'_>,
) -> Result<Stack, Error> {
    let in_use = |error: Error| error.with("used as", "`holdout`");
    let limit = options.max_bytes.unwrap_or_else(guard::default_max_bytes);
    let own = ReadOptions {
        depth_file: None,
        beauty: None,
        holdout: None,
        merge: false,
        carry: Carry::None,
        objects: false,
        max_bytes: Some(limit.saturating_sub(windows::bytes(stack.frame.data, stack.peels.len()))),
        ..options.clone()
    };
    let holdout = read(std::slice::from_ref(source), &own).map_err(in_use)?;
    check(&stack, &holdout).map_err(|error| in_use(error.in_file(source.name())))?;
    merged(stack, holdout, &source.base_name(), options).map_err(in_use)
}

/// Checks that the holdout was rendered as the stack was.
fn check(stack: &Stack, holdout: &Stack) -> Result<(), Error> {
    let display = |stack: &Stack| stack.frame.display;
    if display(stack) != display(holdout) {
        return Err(Error::input("the holdout is of another frame")
            .with("stack", format!("display window {}", display(stack)))
            .with("holdout", format!("display window {}", display(holdout)))
            .help("render both with one display window"));
    }
    let depth = |stack: &Stack| (stack.convention, stack.near_is_one);
    if depth(stack) != depth(holdout) {
        return Err(Error::input("the holdout has depth of another convention")
            .with("stack", format!("{:?}", stack.convention))
            .with("holdout", format!("{:?}", holdout.convention))
            .help("write depth of both alike, or set `convention`"));
    }
    if stack.supersample != holdout.supersample {
        return Err(Error::input("the holdout has another number of samples a pixel")
            .with("stack", format!("{0}×{0}", stack.supersample))
            .with("holdout", format!("{0}×{0}", holdout.supersample))
            .help("render both with as many samples a pixel"));
    }
    Ok(())
}

fn merged(stack: Stack, holdout: Stack, name: &str, options: &ReadOptions) -> Result<Stack, Error> {
    let (convention, limit) = (stack.convention, options.max_bytes.unwrap_or_else(guard::default_max_bytes));
    let black = |peel: &Peel| painted(peel, None);
    let taken =
        holdout.peels.iter().flat_map(|peel| peel.alpha.values()).filter(|&&alpha| alpha > 0.0).count();
    let white = |peel: &Peel| painted(peel, Some(peel.alpha.clone()));
    let merge = |paint: &dyn Fn(&Peel) -> Peel| {
        let seen = (stack.peels.iter().map(paint).collect(), stack.frame.data);
        let held = (holdout.peels.iter().map(black).collect(), holdout.frame.data);
        merge_files::merge_peels([seen, held], convention, limit)
    };
    let (of_shown, _) = merge(&white)?;
    let shown: Vec<Plane> = of_shown.into_iter().map(|Peel { color: [red, _, _], .. }| red).collect();
    let (peels, data) = merge(&Peel::clone)?;

    let announced = Announced { kind: options.kind.or(stack.camera.kind), supersample: stack.supersample };
    let (kind, antialiasing, of_kind) = kind::conclude(&peels, convention, announced)?;
    let reflect = shading::followed(stack.shading, (&stack.peels, stack.frame.data), (&peels, data));
    let mut stack = Stack { peels, shown, kind, antialiasing, shading: reflect, ..stack };
    stack.findings.retain(|finding| finding.about != of_kind.about);
    stack.findings.push(of_kind);
    stack.findings.extend(holdout.findings.into_iter().filter(|finding| finding.warning).map(|finding| {
        Finding { about: "holdout", text: format!("{name}: {}: {}", finding.about, finding.text), ..finding }
    }));
    stack.findings.push(Finding::note(
        "holdout",
        format!("{taken} fragments of {name} hide what is behind them and are not seen; alpha is that of what is seen"),
    ));
    replace_window(&mut stack, data);
    Ok(stack)
}

/// The geometry of `peel`, with `red` for its red; black without.
fn painted(peel: &Peel, red: Option<Plane>) -> Peel {
    let black = || Plane::zeros(peel.alpha.width(), peel.alpha.height());
    Peel {
        color: [red.unwrap_or_else(black), black(), black()],
        alpha: peel.alpha.clone(),
        depth: peel.depth.clone(),
    }
}

/// Makes `data` the data window of `stack`, of the channels beside its peels too.
fn replace_window(stack: &mut Stack, data: Window) {
    let before = std::mem::replace(&mut stack.frame.data, data);
    for channel in stack.carried.channels.iter_mut().chain(&mut stack.mattes) {
        let samples = std::mem::replace(&mut channel.samples, FlatSamples::F32(Vec::new()));
        channel.samples = windows::place_samples(samples, before, data);
    }
}
