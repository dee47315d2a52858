//! One view by every backend and instruction set: the same bytes, at different speeds.

use crate::ReportError;
use crate::plan::{Setting, integrator_name};
use crate::survey::{Cost, lone_thread, render, steady};
use dataset::{Digest, HARD_CASES, specification::IntegratorKind};
use renderer::{
    Instructions, Renderer,
    geometry::{BackendChoice, Isa},
};

/// The view that is rendered: camera at 30 degrees, chart.
pub const VIEW: u32 = 5;

/// The hard case that is rendered.
pub const MATERIAL: usize = 0;

/// What competes to render the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contender {
    /// The integrator, and how much it is to spend.
    pub setting: Setting,
    /// What traces the rays.
    pub backend: BackendChoice,
    /// What the hybrid integrator's kernels run on.
    pub instructions: Instructions,
}

/// The path tracer on every backend and instruction set, then the hybrid integrator on those of
/// this processor.
pub fn contenders() -> Vec<Contender> {
    let traced = [BackendChoice::Native, BackendChoice::Embree]
        .into_iter()
        .chain(Isa::ALL.map(BackendChoice::EmbreeOn));
    traced
        .map(|backend| Contender {
            setting: Setting::Samples(64),
            backend,
            instructions: Instructions::widest(),
        })
        .chain(
            Instructions::available()
                .into_iter()
                .map(|instructions| Contender {
                    setting: Setting::Accuracy(1e-3),
                    backend: BackendChoice::Native,
                    instructions,
                }),
        )
        .collect()
}

/// What a contender did.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Who.
    pub contender: Contender,
    /// What came of it, or why it cannot run here.
    pub result: Result<Run, String>,
}

/// A view that was rendered.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// What it took on one thread.
    pub cost: Cost,
    /// Camera paths or evaluations of the reflectance, by the integrator.
    pub work: u64,
    /// The file's digest.
    pub digest: Digest,
    /// Whether the bytes are those of the integrator's first contender.
    pub same_bytes: bool,
}

impl Contender {
    /// What it is called in tables.
    pub fn name(&self) -> String {
        let integrator = integrator_name(self.setting.integrator());
        match self.setting {
            Setting::Samples(_) => format!("{integrator}, {}", self.backend),
            // It traces no rays.
            Setting::Accuracy(_) => format!("{integrator}, {}", self.instructions),
        }
    }
}

/// Lets every contender render the view on a film of `size_pixels` squared. One that cannot run
/// here says why.
///
/// # Errors
/// When a view cannot be rendered.
pub fn compete(contenders: &[Contender], size_pixels: u32) -> Result<Vec<Outcome>, ReportError> {
    let thread = lone_thread()?;
    let material = &HARD_CASES[MATERIAL].material;
    let mut outcomes: Vec<Outcome> = Vec::new();
    for &contender in contenders {
        let specification = contender.setting.specification(size_pixels);
        let result = match Renderer::new(&specification, contender.backend) {
            Err(error) => Err(error.to_string()),
            Ok(renderer) => {
                let renderer = renderer.with_instructions(contender.instructions);
                let (rendering, cost) =
                    steady(|| render(&thread, &renderer, material, MATERIAL as u32, VIEW))?;
                let digest = Digest::of(&rendering.exr);
                let first = first_digest(&outcomes, contender.setting.integrator());
                Ok(Run {
                    cost,
                    work: rendering.statistics.samples + rendering.statistics.evaluations,
                    digest,
                    same_bytes: first.is_none_or(|first| first == digest),
                })
            }
        };
        outcomes.push(Outcome { contender, result });
    }
    Ok(outcomes)
}

fn first_digest(outcomes: &[Outcome], integrator: IntegratorKind) -> Option<Digest> {
    outcomes
        .iter()
        .filter(|outcome| outcome.contender.setting.integrator() == integrator)
        .find_map(|outcome| Some(outcome.result.as_ref().ok()?.digest))
}
