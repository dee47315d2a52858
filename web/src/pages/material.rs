//! One material: its views, its labels, how it reflects, and how it is rendered again.

use super::{
    Shown, layout,
    numbers::{bytes, grouped, significant},
};
use crate::{images::ErrorMap, plots::lobe, problem::Problem};
use dataset::{CompletedView, Specification, colour::srgb_from_linear};
use jobqueue::Completion;
use limits::web::VIEWER_PIXELS_MAX;
use maud::{Markup, html};
use url::form_urlencoded;

/// The darkest and the brightest that an image is shown, in tenths of a stop.
const EXPOSURE_TENTHS_MAX: i32 = 160;

/// What the query of an address asks for.
struct Wanted {
    view: u32,
    tenths: i32,
}

/// Reads the exposure in the query of an address, in tenths of a stop.
pub fn exposure(query: &str) -> Result<i32, Problem> {
    Ok(wanted(query)?.tenths)
}

fn wanted(query: &str) -> Result<Wanted, Problem> {
    let mut wanted = Wanted { view: 0, tenths: 0 };
    for (key, value) in form_urlencoded::parse(query.as_bytes()) {
        match &*key {
            "view" => {
                let view = value.parse();
                wanted.view = view.map_err(|_| {
                    Problem::bad(format!("view is a number, and {value:?} is none"))
                })?;
            }
            "stops" => {
                let stops: Option<f64> = value.parse().ok();
                let tenths = stops.map(|stops| (10.0 * stops).round());
                let most = f64::from(EXPOSURE_TENTHS_MAX);
                let tenths = tenths.filter(|tenths| tenths.abs() <= most);
                wanted.tenths = tenths.map(|tenths| tenths as i32).ok_or_else(|| {
                    let most = EXPOSURE_TENTHS_MAX / 10;
                    Problem::bad(format!("stops is a number from -{most} to {most}"))
                })?;
            }
            _ => {
                return Err(Problem::bad(format!(
                    "no part of an address is called {key:?}"
                )));
            }
        }
    }
    Ok(wanted)
}

/// The page.
///
/// # Errors
/// When there is no such material or view.
pub fn page(
    shown: &Shown<'_>,
    material: u32,
    completion: Option<&Completion>,
    query: &str,
) -> Result<Markup, Problem> {
    let specification = &shown.site.specification;
    let wanted = wanted(query)?;
    let views = specification.views.len() as u32;
    if wanted.view >= views {
        let last = views - 1;
        return Err(Problem::absent(format!("there are views 0 to {last}")));
    }
    if completion.is_none() && material >= specification.materials {
        return Err(Problem::absent(format!(
            "the dataset has materials 0 to {}",
            specification.materials - 1
        )));
    }
    let title = format!("Material {material}");
    let content = html! {
        div.heading {
            h1 { (title) }
            (neighbours(material, wanted.view, specification.materials))
        }
        @match completion {
            None => p.empty { "This material is not complete yet." },
            Some(completion) => {
                (filmstrip(material, wanted.view, completion))
                @if let Some(image) = completion.views.get(wanted.view as usize) {
                    (viewer(specification, material, &wanted, image))
                }
            }
        }
        (labels(specification, material))
        @if let Some(completion) = completion {
            (rendering(shown, material, wanted.view, completion))
        }
    };
    Ok(layout::page(
        shown,
        Some(layout::Tab::Materials),
        &title,
        content,
    ))
}

fn neighbours(material: u32, view: u32, materials: u32) -> Markup {
    let address = |material: u32| format!("/materials/{material}?view={view}");
    html! {
        nav.pager aria-label="Other materials" {
            @if material > 0 {
                a rel="prev" href=(address(material - 1)) { "Previous" }
            }
            @if material + 1 < materials {
                a rel="next" href=(address(material + 1)) { "Next" }
            }
        }
    }
}

/// All views, small.
fn filmstrip(material: u32, chosen: u32, completion: &Completion) -> Markup {
    html! {
        ul.filmstrip aria-label="Views" {
            @for view in 0..completion.views.len() as u32 {
                li {
                    a href=(format!("/materials/{material}?view={view}"))
                        aria-current=[(view == chosen).then_some("true")] {
                        img src=(format!("/materials/{material}/views/{view}/thumbnail.png"))
                            alt=(format!("View {view}")) width="72" height="72" loading="lazy";
                        span { (view) }
                    }
                }
            }
        }
    }
}

/// One view, large, with the stated error beside it.
fn viewer(
    specification: &Specification,
    material: u32,
    wanted: &Wanted,
    image: &CompletedView,
) -> Markup {
    let view = wanted.view;
    let film = &specification.image;
    let at = format!("/materials/{material}/views/{view}");
    let stops = f64::from(wanted.tenths) / 10.0;
    let has_values = u64::from(film.width) * u64::from(film.height) <= VIEWER_PIXELS_MAX;
    let geometry = &specification.views[view as usize];
    let most = EXPOSURE_TENTHS_MAX / 10;
    html! {
        section.viewer aria-label=(format!("View {view}")) {
            figure {
                div.film {
                    img #image src=(format!("{at}/image.png?stops={stops}"))
                        alt=(format!("Material {material}, view {view}"))
                        width=(film.width) height=(film.height)
                        data-pixels=[has_values.then(|| format!("{at}/pixels"))];
                }
                figcaption {
                    "View " (view) ": camera at " (significant(geometry.camera_elevation_deg))
                    "°, bulb at " (significant(geometry.light_elevation_deg))
                    "°, sample turned by " (significant(geometry.rotation_deg)) "°"
                    @if geometry.checker { ", with colour chart" }
                    "."
                }
                form.exposure method="get" action=(format!("/materials/{material}")) {
                    input type="hidden" name="view" value=(view);
                    label for="stops" { "Exposure, stops" }
                    input #stops type="range" name="stops" min=(-most) max=(most) step="0.1"
                        value=(stops);
                    output #stops-shown for="stops" { (stops) }
                    button type="submit" { "Apply" }
                }
                p #values.values aria-live="off" {
                    @if has_values { "Point at a pixel for its value; arrow keys move the point." }
                    @else { "The image is too large to show values under the pointer." }
                }
            }
            figure {
                div.film {
                    img #errors src=(format!("{at}/errors.png"))
                        alt=(format!("Stated error of material {material}, view {view}"))
                        width=(film.width) height=(film.height) loading="lazy";
                }
                figcaption { "Stated error of each pixel over its tolerance, from rendering the image \
                              again." }
                (scale())
            }
            (facts(&at, image))
        }
    }
}

/// The colours of the map of errors.
fn scale() -> Markup {
    let shade = |place: u32| {
        let over = libm::exp10(-3.0 + 4.0 * f64::from(place) / 79.0);
        let [r, g, b] = ErrorMap::colour(over);
        format!("rgb({r},{g},{b})")
    };
    html! {
        svg.scale viewBox="-12 0 364 34" role="img"
            aria-label="Colours from a thousandth of the tolerance to ten times the tolerance" {
            @for place in 0..80u32 {
                rect x=(10 + 4 * place) y="2" width="4.5" height="12" fill=(shade(place)) {}
            }
            @for (x, text) in [(10, "0.001"), (90, "0.01"), (170, "0.1"), (250, "1"), (330, "10")] {
                line x1=(x) x2=(x) y1="14" y2="19" class="axis" {}
                text x=(x) y="31" text-anchor="middle" { (text) }
            }
        }
    }
}

fn facts(at: &str, image: &CompletedView) -> Markup {
    let statistics = &image.statistics;
    html! {
        table.facts {
            caption { "This image" }
            tbody {
                tr { th scope="row" { "Stated error, mean" } td { (significant(statistics.mean)) " of white" } }
                tr { th scope="row" { "95th percentile" } td { (significant(statistics.p95)) " of white" } }
                tr { th scope="row" { "Largest" } td { (significant(statistics.max)) " of white" } }
                tr { th scope="row" { "Pixels within tolerance" }
                     td { (significant(100.0 * statistics.within_target)) " %" } }
                @if let Some(pixels) = &image.pixels {
                    tr { th scope="row" { "Brightness, mean" }
                         td { (significant(pixels.brightness_mean)) " of white" } }
                    tr { th scope="row" { "Brightness, 99th percentile" }
                         td { (significant(pixels.brightness_p99)) " of white" } }
                }
                tr { th scope="row" { "Evaluations of the model" } td { (grouped(statistics.evaluations)) } }
                @if statistics.samples > 0 {
                    tr { th scope="row" { "Light paths" } td { (grouped(statistics.samples)) } }
                }
                tr { th scope="row" { "File" } td { (bytes(image.bytes)) } }
                tr { th scope="row" { "BLAKE3" } td { code.digest { (image.digest) } } }
                tr { th scope="row" { "Download" } td {
                    a href=(format!("{at}/image.exr")) { "EXR" } " "
                    a href=(format!("{at}/image.png")) download { "PNG" }
                } }
            }
        }
    }
}

fn labels(specification: &Specification, index: u32) -> Markup {
    let sampled = specification.material(index);
    let material = &sampled.material;
    html! {
        section.labels {
            h2 { "Labels" }
            div.beside {
                table.facts {
                    tbody {
                        tr { th scope="row" { "Split" } td { (specification.split(index)) } }
                        tr { th scope="row" { "Roughness" } td { (significant(material.roughness)) " %" } }
                        tr { th scope="row" { "Anisotropy" } td { (significant(material.anisotropy)) } }
                        tr { th scope="row" { "Angle" } td { (significant(material.angle_deg)) "°" } }
                        tr { th scope="row" { "Index of refraction" } td { (significant(material.ior)) } }
                        (colour("Colour at 0°", material.rgb0))
                        (colour("Colour at 90°", material.rgb90))
                    }
                }
                (lobe::plot(material, specification.tint))
            }
        }
    }
}

fn colour(label: &str, linear: [f64; 3]) -> Markup {
    let [r, g, b] =
        linear.map(|channel| (255.0 * srgb_from_linear(channel.clamp(0.0, 1.0))).round());
    html! {
        tr {
            th scope="row" { (label) }
            td {
                svg.swatch viewBox="0 0 24 14" width="24" height="14" aria-hidden="true" {
                    rect width="24" height="14" fill=(format!("rgb({r},{g},{b})")) {}
                }
                " " (linear.map(significant).join(", ")) " linear"
            }
        }
    }
}

/// Who rendered it, and the commands that do it again.
fn rendering(shown: &Shown<'_>, material: u32, view: u32, completion: &Completion) -> Markup {
    let store = quoted(&shown.site.store.to_string());
    let seconds = completion.seconds;
    html! {
        section {
            h2 { "Rendering" }
            p {
                "Worker " code { (completion.worker) } " rendered all views in "
                (significant(seconds)) " s."
            }
            p { "Render this view again and compare its digest, or check the whole store:" }
            pre tabindex="0" { code {
                @if let Some(image) = completion.views.get(view as usize) {
                    "brdfarm render --store " (store) " --material " (material) " --view " (view)
                    " --expect " (image.digest) " --out view.exr\n"
                }
                "brdfarm dataset verify --store " (store) " --rerender 1%"
            } }
        }
    }
}

/// A word for a shell.
fn quoted(word: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"/._-:@=+".contains(&byte);
    if !word.is_empty() && word.bytes().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_says_view_and_exposure() {
        let wanted = wanted("view=3&stops=-2.54").unwrap();
        assert_eq!((wanted.view, wanted.tenths), (3, -25));
        for query in [
            "view=-1",
            "view=x",
            "stops=17",
            "stops=nan",
            "stops=",
            "exposure=1",
        ] {
            assert!(self::wanted(query).is_err(), "{query}");
        }
    }

    #[test]
    fn a_shell_takes_any_store_for_one_word() {
        assert_eq!(quoted("runs/store-1"), "runs/store-1");
        assert_eq!(quoted("my store"), "'my store'");
        assert_eq!(quoted("a'b; rm"), "'a'\\''b; rm'");
        assert_eq!(quoted(""), "''");
    }
}
