//! Speed against error of the renderer: a stated set of materials and views is rendered at a ladder
//! of settings with both integrators, compared with a far finer rendering, and told as CSV files,
//! plots and one page that stands alone.
//!
//! | module | what |
//! | --- | --- |
//! | [`plan`] | what is rendered |
//! | [`survey`] | rendering and measuring it |
//! | [`comparison`] | how far a film is from its reference |
//! | [`backends`] | one view by every backend |
//! | [`shapes`] | square, sphere and mesh beside each other |
//! | [`statistics`] | quantiles, slopes, histograms |
//! | [`machine`] | what it ran on |

pub mod backends;
pub mod comparison;
mod findings;
pub mod machine;
mod numbers;
mod page;
pub mod plan;
mod plots;
pub mod shapes;
pub mod statistics;
pub mod survey;
mod tables;

use backends::Outcome;
use plan::Plan;
use shapes::ShapeMeasurement;
use survey::Measurement;

/// What was found.
#[derive(Debug)]
pub struct Report {
    /// What was rendered.
    pub plan: Plan,
    /// Each rendering.
    pub measurements: Vec<Measurement>,
    /// One view by every backend.
    pub backends: Vec<Outcome>,
    /// Square, sphere and mesh.
    pub shapes: Vec<ShapeMeasurement>,
    /// Names and values of the machine.
    pub machine: Vec<(&'static str, String)>,
}

/// A file of a report.
#[derive(Clone, Debug)]
pub struct File {
    /// Its name.
    pub name: &'static str,
    /// Its text.
    pub text: String,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A view could not be rendered.
    #[error(transparent)]
    Render(#[from] renderer::RenderError),
    /// The mesh of the comparison is none: a fault of this program.
    #[error("the mesh of the report cannot be made: {0}: please report this")]
    Mesh(#[from] mesh::MeshError),
    /// No thread could be started.
    #[error("cannot start a thread to render on: {0}")]
    Thread(#[from] rayon::ThreadPoolBuildError),
    /// A plot could not be drawn: a fault of this program.
    #[error("the plot {name} cannot be drawn: {reason}: please report this")]
    Plot {
        /// The plot's name.
        name: &'static str,
        /// What the library says.
        reason: String,
    },
    /// A table could not be written: a fault of this program.
    #[error("a table cannot be written as CSV: {0}")]
    Table(#[from] csv::Error),
}

impl Report {
    /// Renders and measures what `plan` asks for. `advance` is called after each rendering.
    ///
    /// # Errors
    /// When a view cannot be rendered.
    pub fn make(plan: Plan, advance: &(dyn Fn() + Sync)) -> Result<Self, ReportError> {
        let measurements = survey::survey(&plan, advance)?;
        let backends = backends::compete(&backends::contenders(), plan.size_pixels)?;
        let shapes = shapes::compare_shapes(&plan, advance)?;
        Ok(Self {
            plan,
            measurements,
            backends,
            shapes,
            machine: machine::facts(),
        })
    }

    /// The tables as CSV, the plots as SVG, and the page, `report.html`, last.
    ///
    /// # Errors
    /// When a plot or a table cannot be written, which is a fault of this program.
    pub fn files(&self) -> Result<Vec<File>, ReportError> {
        let mut files = tables::write(self)?;
        let plots = plots::draw(self)?;
        let page = page::compose(self, &plots);
        files.extend(plots.into_iter().map(|plot| File {
            name: plot.file,
            text: plot.svg,
        }));
        files.push(File {
            name: "report.html",
            text: page,
        });
        Ok(files)
    }
}
