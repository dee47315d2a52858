//! How the completed materials cover the parameters, and what was measured of them.

use super::{
    Shown, layout,
    numbers::{bytes, grouped, span},
};
use crate::{
    catalogue::{Entry, FIELDS, Field},
    plots::histogram::{Histogram, Series},
};
use dataset::{Specification, Split, specification::Parameters};
use maud::{Markup, html};

/// The page.
pub fn page(shown: &Shown<'_>) -> Markup {
    let site = shown.site;
    let listing = site.catalogue.listing();
    let entries = &listing.entries;
    let total: u64 = entries.iter().map(|entry| entry.bytes).sum();
    let seconds: f64 = entries.iter().map(|entry| entry.seconds).sum();
    let content = html! {
        h1 { "Coverage" }
        p.count {
            (grouped(entries.len() as u64)) " complete materials, "
            (grouped(entries.len() as u64 * site.specification.views.len() as u64)) " images, "
            (bytes(total)) ", " (span(seconds)) " of rendering."
        }
        @if entries.is_empty() {
            p.empty { "No material is complete yet." }
        } @else {
            (legend())
            h2 { "Labels" }
            div.plots {
                @for field in FIELDS.iter().filter(|field| field.is_label).skip(1) {
                    (plot(field, entries, &site.specification))
                }
            }
            h2 { "Measured" }
            p.note {
                "Of the views of a material the stated error and the share of pixels off tolerance \
                are those of its worst view; brightness is the mean over its views."
            }
            div.plots {
                @for field in FIELDS.iter().filter(|field| !field.is_label) {
                    (plot(field, entries, &site.specification))
                }
            }
        }
    };
    layout::page(shown, Some(layout::Tab::Coverage), "Coverage", content)
}

const SPLITS: [(Split, &str); 3] = [
    (Split::Train, "train"),
    (Split::Validation, "validation"),
    (Split::Test, "test"),
];

fn legend() -> Markup {
    html! {
        ul.legend aria-label="Colours of splits" {
            @for (split, class) in SPLITS {
                li { svg viewBox="0 0 10 10" width="12" height="12" aria-hidden="true" {
                    rect width="10" height="10" class=(class) {}
                } " " (split) }
            }
        }
    }
}

/// What a label can be, if it is one.
fn range(field: &Field, parameters: &Parameters) -> Option<[f64; 2]> {
    match field.name {
        "roughness" => Some(parameters.roughness),
        "anisotropy" => Some(parameters.anisotropy),
        "angle_deg" => Some(parameters.angle_deg),
        "ior" => Some(parameters.ior),
        _ if field.is_label => Some([0.0, 1.0]),
        _ => None,
    }
}

fn plot(field: &Field, entries: &[Entry], specification: &Specification) -> Markup {
    let values = |split: Split| {
        let of_split = entries.iter().filter(move |entry| entry.split == split);
        of_split.filter_map(|entry| (field.of)(entry)).collect()
    };
    let series = SPLITS.map(|(split, class)| Series {
        class,
        values: values(split),
    });
    Histogram {
        title: field.label,
        axis: &field.title(),
        is_logarithmic: !field.is_label && field.name != "missed",
        range: range(field, &specification.parameters),
    }
    .draw(&series)
}
