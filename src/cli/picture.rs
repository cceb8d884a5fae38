//! One picture from files to files: of a single render, or of a frame of a sequence.

use super::drivers::{in_bands, prepare};
use super::outputs::OutputArgs;
use thinlens::error::Error;
use thinlens::gpu::Device;
use thinlens::methods::{Plan, Progress};
use thinlens::render::{Job, Rendered, fits_into_memory};
use thinlens::settings::Focus;
use thinlens::stack::Stack;

/// What is told of a picture while it is made.
pub(super) trait Watcher: Sync {
    /// The stack was read, and `plan` was made; it will be carried out by `device`.
    ///
    /// # Errors
    /// A decision that the watcher does not accept.
    fn decided(&self, decided: &Decided<'_>) -> Result<(), Error>;

    /// This share of the blur is done.
    fn blurred(&self, share: f32);
}

/// A picture that is about to be made.
#[derive(Debug)]
pub(super) struct Decided<'a> {
    /// The stack, with what was concluded of it.
    pub(super) stack: &'a Stack,
    /// What is in focus.
    pub(super) focus: &'a Focus,
    /// What will be simulated.
    pub(super) plan: &'a Plan,
    /// Where.
    pub(super) device: &'a Device,
}

/// Renders `job` and writes `outputs` except for what goes to standard output as JSON. A frame that does not fit into memory is rendered in
/// bands of rows. `digest` says in the picture's header what determined it; where it could not be computed, reading
/// says why.
///
/// # Errors
/// Those of reading, of the lens, of the method and of the files.
pub(super) fn render(
    job: &Job,
    outputs: &OutputArgs,
    digest: Result<String, Error>,
    watcher: &dyn Watcher,
) -> Result<Rendered, Error> {
    if !fits_into_memory(job)? {
        outputs.check_bands()?;
    }
    let progress: &Progress<'_> = &|share| watcher.blurred(share);
    let codec = outputs.encoding().codec;
    let rendered = if let Some(bands) = in_bands(job, codec)? {
        let (stack, focus) = (bands.stack(), bands.focus());
        watcher.decided(&Decided { stack, focus, plan: bands.plan(), device: bands.device() })?;
        let options = outputs.encoding().exr_options(bands.stack().precision);
        bands.write(&outputs.output, &options, Some(digest?), progress)?
    } else {
        let prepared = prepare(job)?;
        let (stack, focus) = (&prepared.stack, &prepared.settings.lens.focus.value);
        watcher.decided(&Decided { stack, focus, plan: &prepared.plan, device: &prepared.device })?;
        let mut rendered = prepared.blur(progress)?;
        rendered.set_digest(digest?);
        outputs.write(&mut rendered)?;
        rendered
    };
    outputs.write_report(job, &rendered)?;
    Ok(rendered)
}
