//! Films of materials beside one, on its tiles and by its rules.

use dataset::{HARD_CASES, Material, Specification, specification::IntegratorKind};
use renderer::{RenderError, Renderer, film::Film, geometry::BackendChoice};

/// Light at 45 degrees, camera at 45: the film shows the chart.
const WITH_CHART: u32 = 6;

/// The preset in small, at a tenth of its tolerance.
fn specification() -> Specification {
    let mut specification = Specification::preset();
    (specification.image.width, specification.image.height) = (16, 16);
    specification.accuracy.relative = 1e-4;
    specification.accuracy.absolute = 1e-5;
    specification
}

fn renderer(specification: &Specification) -> Renderer {
    Renderer::new(specification, BackendChoice::Native).expect("views")
}

/// The material with more of the anisotropy.
fn beside(material: &Material, more: f64) -> Material {
    Material {
        anisotropy: material.anisotropy + more,
        ..*material
    }
}

/// The values of a film's upper rows, where the chart is.
fn chart_rows(film: &Film) -> Vec<f64> {
    let pixels = film.pixels[..4 * film.width as usize].iter();
    pixels.flat_map(|pixel| pixel.value).collect()
}

/// The largest second difference of values at equal steps.
fn bend(values: &[Vec<f64>]) -> f64 {
    let triples = values.windows(3).flat_map(|triple| {
        let [before, here, after] = triple else {
            unreachable!("windows of three");
        };
        let all = before.iter().zip(here).zip(after);
        all.map(|((before, here), after)| (before - 2.0 * here + after).abs())
    });
    triples.fold(0.0, f64::max)
}

#[test]
fn a_material_like_itself_has_its_own_film() {
    let specification = specification();
    let renderer = renderer(&specification);
    for (index, view) in [(7, 0), (7, WITH_CHART), (400, WITH_CHART), (2, 12)] {
        let material = specification.material(index).material;
        let rendering = renderer.render(&material, None, view).expect("a film");
        let own = renderer.discretization(&material, view).expect("a view");
        let film = renderer.film_like(&material, &own).expect("a film");
        let values = |film: &Film| -> Vec<[f64; 3]> {
            film.pixels.iter().map(|pixel| pixel.value).collect()
        };
        assert_eq!(values(&film), values(&rendering.film), "{index}, {view}");
    }
}

/// The material's own tiles change from one step to another: its own films bend by 1.3e-6 of white, those on
/// one discretization by 1.5e-7.
#[test]
fn films_of_materials_beside_one_change_smoothly_and_within_the_tolerance() {
    const STEP: f64 = 4e-3;
    let specification = specification();
    let renderer = renderer(&specification);
    let material = specification.material(7).material;
    let like = renderer.discretization(&material, WITH_CHART);
    let like = like.expect("a view");
    let (mut films, mut owns) = (Vec::new(), Vec::new());
    for step in -6..=6 {
        let moved = beside(&material, STEP * f64::from(step));
        let film = renderer.film_like(&moved, &like).expect("a film");
        let own = renderer.render(&moved, None, WITH_CHART).expect("a film");
        for (one, other) in film.pixels.iter().zip(&own.film.pixels) {
            let off = (0..3).map(|i| (one.value[i] - other.value[i]).abs());
            let off = off.fold(0.0, f64::max);
            assert!(off <= one.error + other.error, "{step}: {off:e}");
        }
        films.push(chart_rows(&film));
        owns.push(chart_rows(&own.film));
    }
    let [like, own] = [&films, &owns].map(|films| bend(films));
    assert!(4.0 * like < own, "{like:e} of {own:e}");
}

/// However far the other material is: rules for a wide lobe meet the narrowest, and the other way round.
#[test]
fn any_material_can_be_like_any_other() {
    let specification = specification();
    let renderer = renderer(&specification);
    let materials = HARD_CASES.map(|case| case.material);
    for (index, of) in materials.iter().enumerate() {
        let like = renderer.discretization(of, WITH_CHART).expect("a view");
        let material = &materials[(index + 5) % materials.len()];
        let film = renderer.film_like(material, &like).expect("a film");
        assert!(film.pixels.iter().all(|pixel| pixel.error.is_finite()));
    }
}

/// Random numbers are the same for both, and bad input is refused.
#[test]
fn traced_films_and_errors() {
    let mut specification = specification();
    specification.integrator.kind = IntegratorKind::Path;
    let renderer = renderer(&specification);
    let material = specification.material(7).material;
    let like = renderer.discretization(&material, 8).expect("a view");
    let film = renderer.film_like(&material, &like).expect("a film");
    let own = renderer.render(&material, None, 8).expect("a film").film;
    assert_eq!(film.pixels[100].value, own.pixels[100].value);

    let none = renderer.discretization(&material, 99);
    assert!(matches!(
        none,
        Err(RenderError::NoSuchView { view: 99, .. })
    ));
    let refused = renderer.film_like(&beside(&material, 2.0), &like);
    assert!(matches!(refused, Err(RenderError::Material(_))));
}
