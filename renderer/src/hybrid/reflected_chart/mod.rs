//! The colour chart in the sample.

mod detail;
mod gather;
pub mod glossy;
mod integrals;
pub mod lit_chart;
mod mirror;
mod wide;
mod window;

use super::budget::reflected_chart::PATCHES_MAX;
use super::budget::{
    TILING, glossy as glossy_budget, is_glossy, mirror as mirror_budget, reflected_chart,
};
use super::chart_on_film::ChartOnFilm;
use super::finer_view::FinerView;
use super::interreflection::Interreflection;
use super::view::View;
use crate::film::canvas::Canvas;
use crate::film::demand::{Demand, FunctionError, Terms};
use crate::film::region::Region;
use crate::film::tiling::{Shade, integrate, integrate_on};
use crate::film::{FilmPixel, target};
use crate::numerics::channels::largest_difference;
use crate::numerics::polygon::Rectangle;
use crate::numerics::tolerance::Tolerance;
use crate::reflectance::Reflectance;
use detail::Detail;
use glossy::{GlossyChart, SeenFrom};
use integrals::LightBatch;
use lit_chart::{LitChart, Missed, PARABOLA, QUARTIC, RadiantChart};
use mirror::NearMirror;
use wide::ChartOffWideLobe;

/// Adds the chart in the sample to the film; returns evaluations.
pub fn add(
    view: &View,
    canvas: &mut Canvas<'_>,
    chart: &ChartOnFilm,
    interreflection: &Interreflection,
    reflectance: &Reflectance,
) -> u64 {
    let light = Light {
        view,
        chart,
        interreflection,
    };
    let error = interreflection.function_error();
    let glossy = |chart| GlossyChart::new(&chart, reflectance, view.instructions);
    match (is_glossy(reflectance), light.by_parabolas_on_patches()) {
        (false, Some(parabolas)) => {
            add_wide(view, canvas, &parabolas.map(Into::into), error, reflectance)
        }
        (false, None) => {
            let quartics = light.told(RadiantChart::<QUARTIC>::from);
            add_wide(view, canvas, &quartics, error, reflectance)
        }
        (true, Some(parabolas)) => {
            let charts = (parabolas.clone().map(glossy), parabolas.map(Into::into));
            add_glossy(view, canvas, &charts, error, reflectance)
        }
        (true, None) => {
            let parabolas = light.told(glossy);
            let quartics = light.told(RadiantChart::<QUARTIC>::from);
            add_glossy(view, canvas, &(parabolas, quartics), error, reflectance)
        }
    }
}

/// The light on the chart that goes on to the sample.
struct Light<'a> {
    view: &'a View,
    chart: &'a ChartOnFilm,
    interreflection: &'a Interreflection,
}

/// The chart with its light told by polynomials.
#[derive(Clone)]
struct Told<T> {
    chart: T,
    missed: Missed<T>,
}

impl<T> Told<T> {
    fn map<U>(self, map: impl Fn(T) -> U) -> Told<U> {
        Told {
            chart: map(self.chart),
            missed: self.missed.map(map),
        }
    }
}

impl Light<'_> {
    /// By parabolas on whole patches, if the tolerance lets them.
    fn by_parabolas_on_patches(&self) -> Option<Told<LitChart<PARABOLA>>> {
        self.serving(1, &|chart| chart)
    }

    /// By polynomials on as few parts as the tolerance asks for, and what `of` makes of them: a chart in many parts
    /// takes megabytes, which are not kept.
    fn told<const NODES: usize, T>(&self, of: impl Fn(LitChart<NODES>) -> T) -> Told<T> {
        let patches = self.chart.patches.len() as u32;
        let mut parts = 1;
        loop {
            if let Some(told) = self.serving(parts, &of) {
                return told;
            }
            if (2 * parts) * (2 * parts) * patches > PATCHES_MAX {
                break;
            }
            parts *= 2;
        }
        Told {
            chart: of(self.in_parts(parts)),
            missed: Missed::Against(of(self.in_parts(2 * parts))),
        }
    }

    fn in_parts<const NODES: usize>(&self, parts: u32) -> LitChart<NODES> {
        let gap = self.interreflection.gap();
        LitChart::new(self.chart, gap, parts, |at| self.irradiance(at))
    }

    /// By polynomials on such parts of patches, if these miss no more than the tolerance lets them: of the bulb's light
    /// on the chart, and of all.
    fn serving<const NODES: usize, T>(
        &self,
        parts: u32,
        of: &impl Fn(LitChart<NODES>) -> T,
    ) -> Option<Told<T>> {
        let gap = self.interreflection.gap();
        let allowed = self.view.budget.light_on_chart();
        let direct = |at: [f64; 2]| [self.view.bulb_on_chart(&self.chart.plane, at); 3];
        let of_direct = LitChart::<NODES>::new(self.chart, gap, parts, direct).missed(direct);
        if of_direct > allowed {
            return None;
        }
        let chart = self.in_parts(parts);
        let missed = chart.missed(|at| self.irradiance(at));
        if missed > reflected_chart::OFF_SAMPLE_SHARE * allowed {
            return None;
        }
        let chart = of(chart);
        let missed = if missed <= reflected_chart::STATED_SHARE * allowed {
            Missed::AtMost(missed)
        } else {
            Missed::Against(of(self.in_parts(2 * parts)))
        };
        Some(Told { chart, missed })
    }

    /// Over pi.
    fn irradiance(&self, at: [f64; 2]) -> [f64; 3] {
        let direct = self.view.bulb_on_chart(&self.chart.plane, at);
        let off_sample = self.interreflection.on_chart_for_sample(at);
        off_sample.map(|channel| channel + direct)
    }
}

/// Adds the chart off a lobe that is not glossy; returns evaluations.
fn add_wide<const NODES: usize>(
    view: &View,
    canvas: &mut Canvas<'_>,
    Told { chart, missed }: &Told<RadiantChart<NODES>>,
    function_error: FunctionError,
    reflectance: &Reflectance,
) -> u64 {
    let detail = Detail::new(view, chart.whole_plane, reflectance);
    let side_max = detail.side_max(view.budget.wide_tile);
    let accuracy = view
        .budget
        .chart_beside(function_error, reflected_chart::SHARE_LEAST);
    let terms = view.budget.smooth_terms();
    let demand = Demand {
        accuracy: &accuracy,
        faint: view.budget.chart.absolute,
        terms,
        side_max,
        feature: detail.feature(side_max.min(terms.spread() * longest(view))),
        evaluations_max: view.evaluations_max(reflected_chart::LIMIT),
        tolerance: view.budget.wide_rule,
        shares: view.budget.tiling(),
        instructions: view.instructions,
    };
    let shade = ChartOffWideLobe {
        view,
        chart,
        missed: missed.as_ref(),
        reflectance,
        function_error,
    };
    integrate(canvas, &view.sample, &[whole(view)], &demand, &shade)
}

/// The chart as glossy lobes see it: its light told by parabolas, and for the points at which the rules of a wide lobe
/// serve by polynomials of any degree.
type GlossyCharts<'a, const NODES: usize> = (Told<GlossyChart<'a>>, Told<RadiantChart<NODES>>);

/// Adds the chart off a glossy lobe; returns evaluations.
///
/// A pixel of a coarse film holds more edges of patches than a tile can resolve. So a near mirror is rendered on a finer
/// film at once. Another sample is where too many of its pixels miss their target on this one.
fn add_glossy<const NODES: usize>(
    view: &View,
    canvas: &mut Canvas<'_>,
    charts: &GlossyCharts<'_, NODES>,
    function_error: FunctionError,
    reflectance: &Reflectance,
) -> u64 {
    let detail = Detail::new(view, charts.0.chart.plane, reflectance);
    let times = detail.finer_times();
    let most = view.evaluations_max(glossy_budget::LIMIT);
    let add_on = |view: &View, canvas: &mut Canvas<'_>, most| {
        add_glossy_on(view, canvas, charts, (function_error, most), reflectance)
    };
    let plane = &charts.0.chart.plane;
    let finer = (plane.columns * plane.rows <= glossy_budget::FINER_PATCHES_MAX)
        .then(|| FinerView::new(view, times, mirror_budget::PIXELS_MAX))
        .flatten();
    let Some(finer) = finer else {
        return add_on(view, canvas, most);
    };
    let add_on_finer = |finer: &View, canvas: &mut Canvas<'_>| {
        let [own, least] = [finer.size, glossy_budget::FINER_LIMIT_OF]
            .map(|size| view.budget.evaluations_max(glossy_budget::LIMIT, size));
        add_on(finer, canvas, own.min(least.max(most)))
    };
    if detail.is_near_mirror(&view.budget, times) {
        return finer.add_to(canvas, add_on_finer);
    }
    let before = canvas.pixels.to_vec();
    let evaluations = add_on(view, canvas, most);
    if !misses_much(view, canvas, &before) {
        return evaluations;
    }
    canvas.pixels.copy_from_slice(&before);
    evaluations + finer.add_to(canvas, add_on_finer)
}

/// Whether more than a few pixels miss more than what is added to them may.
fn misses_much(view: &View, canvas: &Canvas<'_>, before: &[FilmPixel]) -> bool {
    let most = TILING.doubt + TILING.beside;
    let missing = canvas.pixels.iter().zip(before).filter(|(pixel, before)| {
        pixel.error - before.error > most * target(&view.budget.chart, pixel.value)
    });
    missing.count() > (glossy_budget::MISSING_MAX * before.len() as f64) as usize
}

/// Adds the chart off a glossy lobe on a film as it is; returns evaluations.
fn add_glossy_on<const NODES: usize>(
    view: &View,
    canvas: &mut Canvas<'_>,
    (parabolas, polynomials): &GlossyCharts<'_, NODES>,
    (function_error, evaluations_max): (FunctionError, u64),
    reflectance: &Reflectance,
) -> u64 {
    let detail = Detail::new(view, parabolas.chart.plane, reflectance);
    let side_max = detail.side_max(glossy_budget::TILE);
    let accuracy = view
        .budget
        .chart_beside(function_error, reflected_chart::SHARE_LEAST);
    let demand = Demand {
        accuracy: &accuracy,
        faint: view.budget.chart.absolute,
        terms: Terms::Many,
        side_max,
        feature: detail.feature(side_max.min(longest(view))),
        evaluations_max,
        tolerance: view.budget.glossy_rule,
        shares: view.budget.tiling(),
        instructions: view.instructions,
    };
    let wide = ChartOffWideLobe {
        view,
        chart: &polynomials.chart,
        missed: polynomials.missed.as_ref(),
        reflectance,
        function_error,
    };
    let Some(bounds) = view
        .sample
        .polygon()
        .bounds()
        .intersection(&canvas.bounds())
    else {
        return 0;
    };
    let (parts, evaluations) = match detail.around_mirror_image(&view.budget, &bounds) {
        Some(around) => {
            let (finer, missed) = match &parabolas.missed {
                Missed::AtMost(missed) => (None, *missed),
                Missed::Against(finer) => (Some(finer), 0.0),
            };
            let near = NearMirror {
                view,
                chart: &parabolas.chart,
                finer,
                missed,
                function_error,
                accuracy: &accuracy,
                tolerance: view.budget.glossy_rule,
            };
            mirror::add(&near, canvas, (&around, &bounds))
        }
        None => (vec![bounds], 0),
    };
    let shade = ChartOffGlossyLobe {
        chart: &parabolas.chart,
        missed: parabolas.missed.as_ref(),
        wide,
    };
    let regions = [whole(view)];
    evaluations + integrate_on(canvas, &view.sample, (&regions, &parts), &demand, &shade)
}

/// The longer side of the film in pixels.
fn longest(view: &View) -> f64 {
    let [width, height] = view.size;
    f64::from(width.max(height))
}

/// All of the sample.
fn whole(view: &View) -> Region<'_> {
    Region {
        outline: *view.sample.polygon(),
        by_pixel: Some(&view.sample),
        factor: [1.0; 3],
    }
}

/// The chart off a glossy lobe.
struct ChartOffGlossyLobe<'a, const NODES: usize> {
    chart: &'a GlossyChart<'a>,
    missed: Missed<&'a GlossyChart<'a>>,
    /// What serves where no polynomial along the lobe's narrow axis tells the light: seen at a slant
    /// and from near by, it may bend too much over the lobe.
    wide: ChartOffWideLobe<'a, NODES>,
}

impl<const NODES: usize> ChartOffGlossyLobe<'_, NODES> {
    /// Whether the rules of wide lobes follow the polynomials.
    fn has_wide_rules(&self) -> bool {
        let lobe = &self.wide.reflectance.lobe;
        lobe.n_u < glossy_budget::wide_rule_exponent(lobe.n_u / lobe.n_v)
    }

    /// Orders of polynomials: one more where nothing follows them.
    fn orders(&self) -> u32 {
        glossy_budget::ORDERS + u32::from(!self.has_wide_rules())
    }
}

impl<const NODES: usize> Shade for ChartOffGlossyLobe<'_, NODES> {
    type Scratch = (glossy::Scratch, LightBatch);

    fn at(
        &self,
        (glossy, batch): &mut Self::Scratch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> ([f64; 3], u32) {
        let Some(above) = tolerance.level().checked_sub(self.orders()) else {
            let (position, wo) = self.wide.view.sample_point(film_point);
            return self.chart.reflected(position, wo, tolerance, glossy);
        };
        let rule = self.wide.view.budget.wide_rule;
        let tolerance = (0..above).fold(rule, |rule, _| rule.finer());
        self.wide.at(batch, film_point, tolerance)
    }

    fn finest_level(&self) -> u32 {
        if self.has_wide_rules() {
            self.orders() + 1
        } else {
            self.orders() - 1
        }
    }

    fn kind_changes_at(&self) -> Option<u32> {
        Some(self.orders())
    }

    /// Near the chart, light bends over lobes that are not the narrowest: there rules missed ten times more at the
    /// sample's edge than in the middle of a tile.
    fn is_uneven(&self) -> bool {
        self.has_wide_rules()
    }

    fn hides_between(&self, tile: &Rectangle, corners: &[[f64; 2]]) -> Option<usize> {
        let seen = corners.iter().map(|&at| {
            let (position, wo) = self.wide.view.sample_point(at);
            let at = [0, 1].map(|axis| tile.local(axis, at[axis]));
            SeenFrom { at, position, wo }
        });
        self.chart.hides_between(&seen.collect::<Vec<_>>())
    }

    fn function_error(&self, cell: &Rectangle) -> FunctionError {
        self.wide.function_error(cell)
    }

    fn light_error(
        &self,
        (glossy, _): &mut Self::Scratch,
        film_point: [f64; 2],
        tolerance: Tolerance,
    ) -> (f64, u32) {
        let finer = match &self.missed {
            Missed::AtMost(missed) => return (*missed, 0),
            Missed::Against(finer) => finer,
        };
        let (position, wo) = self.wide.view.sample_point(film_point);
        let [(coarse, first), (fine, second)] =
            [self.chart, finer].map(|chart| chart.reflected(position, wo, tolerance, glossy));
        (largest_difference(coarse, fine), first + second)
    }
}
