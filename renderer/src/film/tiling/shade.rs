//! Functions of the film.

use crate::film::demand::FunctionError;
use crate::film::edge::{Edge, OnPixel};
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;

/// A function of the film. What it works with is kept from call to call.
pub trait Shade: Sync {
    /// Buffers.
    type Scratch: Default;

    /// The function at (column, row) and how many evaluations of the reflectance it took.
    fn at(
        &self,
        scratch: &mut Self::Scratch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> ([f64; 3], u32);

    /// The highest level of a tolerance that makes a difference to the function.
    fn finest_level(&self) -> u32 {
        3
    }

    /// The level from which on rules are of another kind, or would be if they were fine enough; `None` where all are of
    /// one. One kind may converge where the other does not, and rules of the first may agree by chance.
    fn kind_changes_at(&self) -> Option<u32> {
        None
    }

    /// Whether rules may miss far more at a tile's corners than within.
    fn is_uneven(&self) -> bool {
        false
    }

    /// Whether it costs so little that tiles are looked at in every gap between their nodes.
    fn is_cheap(&self) -> bool {
        false
    }

    /// Whether all nodes of a tile may miss a part of the function: along which axis it is then to be halved. `corners`
    /// are those of what the outline leaves of the tile.
    fn hides_between(&self, _tile: &Rectangle, _corners: &[[f64; 2]]) -> Option<usize> {
        None
    }

    /// An edge that crosses a line of the film along `axis` between two places, as [`OnPixel::edge`].
    fn edge(&self, _axis: usize, _across: f64, _between: [f64; 2]) -> Option<Edge> {
        None
    }

    /// What the function may be off by on a part of a pixel that no rule shows.
    fn function_error(&self, _cell: &Rectangle) -> FunctionError {
        FunctionError::default()
    }

    /// The error of the function at a film point that comes from the light given to it, and
    /// evaluations.
    fn light_error(
        &self,
        _scratch: &mut Self::Scratch,
        _film_point: [f64; 2],
        _tolerance: Tolerance,
    ) -> (f64, u32) {
        (0.0, 0)
    }
}

/// The function with a thread's buffers, and what it took.
pub struct Counted<'a, S: Shade> {
    pub shade: &'a S,
    pub scratch: &'a mut S::Scratch,
    /// Evaluations.
    pub spent: u64,
    /// Points that they were spent on.
    pub points: u64,
}

impl<S: Shade> Counted<'_, S> {
    pub fn at(&mut self, film_point: [f64; 2], tolerance: Tolerance) -> [f64; 3] {
        let (value, evaluations) = self.shade.at(self.scratch, film_point, tolerance);
        self.spent += u64::from(evaluations);
        self.points += 1;
        value
    }

    /// The function worked out to this tolerance.
    pub fn at_tolerance(&mut self, tolerance: Tolerance) -> impl OnPixel {
        AtTolerance {
            function: self,
            tolerance,
        }
    }

    pub fn light_error(&mut self, film_point: [f64; 2], tolerance: Tolerance) -> f64 {
        let (error, evaluations) = self.shade.light_error(self.scratch, film_point, tolerance);
        self.spent += u64::from(evaluations);
        error
    }
}

/// A function worked out to a tolerance.
struct AtTolerance<'a, 'b, S: Shade> {
    function: &'a mut Counted<'b, S>,
    tolerance: Tolerance,
}

impl<S: Shade> OnPixel for AtTolerance<'_, '_, S> {
    fn at(&mut self, film_point: [f64; 2]) -> ([f64; 3], u64) {
        let before = self.function.spent;
        let value = self.function.at(film_point, self.tolerance);
        (value, self.function.spent - before)
    }

    fn edge(&self, axis: usize, across: f64, between: [f64; 2]) -> Option<Edge> {
        self.function.shade.edge(axis, across, between)
    }
}
