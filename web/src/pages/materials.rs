//! A grid of materials, filtered and sorted as the address says.

use super::{
    Shown, layout,
    numbers::{grouped, significant},
};
use crate::catalogue::{Entry, FIELDS, Filter, FilterError};
use axum::response::{IntoResponse, Response};
use dataset::Split;
use http::StatusCode;
use limits::web::MATERIALS_A_PAGE;
use maud::{Markup, html};

/// The page.
pub fn page(shown: &Shown<'_>, query: &str) -> Response {
    match Filter::parse(query) {
        Ok(filter) => content(shown, filter, None).into_response(),
        Err(error) => {
            let page = content(shown, Filter::default(), Some(&error));
            (StatusCode::BAD_REQUEST, page).into_response()
        }
    }
}

fn content(shown: &Shown<'_>, mut filter: Filter, error: Option<&FilterError>) -> Markup {
    let site = shown.site;
    let listing = site.catalogue.listing();
    let chosen = filter.choose(&listing.entries, &site.specification);
    let pages = chosen.len().div_ceil(MATERIALS_A_PAGE).max(1);
    filter.page = filter.page.min(pages);
    filter.view = filter.view.min(site.specification.views.len() as u32 - 1);
    let first = (filter.page - 1) * MATERIALS_A_PAGE;
    let there = chosen.iter().skip(first).take(MATERIALS_A_PAGE);
    let there: Vec<&Entry> = there.map(|index| &listing.entries[*index]).collect();
    let content = html! {
        h1 { "Materials" }
        @if let Some(error) = error {
            p.problem role="alert" { (error) ". All materials are shown." }
        }
        (form(shown, &filter))
        p.count {
            @if filter.is_narrow() {
                (grouped(chosen.len() as u64)) " of "
            }
            (grouped(listing.entries.len() as u64)) " complete materials"
            @if listing.entries.len() as u64 != u64::from(site.specification.materials) {
                ", " (grouped(site.specification.materials.into())) " in the dataset"
            }
            "."
            @if listing.is_cut {
                " There are more than these pages hold in memory; the others are not shown."
            }
        }
        @if there.is_empty() {
            p.empty { @if filter.is_narrow() { "No material is like that." }
                      @else { "No material is complete yet." } }
        }
        ul.grid {
            @for entry in there { li { (card(&filter, entry)) } }
        }
        (pager(&filter, pages))
    };
    layout::page(shown, Some(layout::Tab::Materials), "Materials", content)
}

fn card(filter: &Filter, entry: &Entry) -> Markup {
    let material = entry.material;
    let view = filter.view;
    let sorted_by = filter.sort.field();
    html! {
        a.card href=(format!("/materials/{material}?view={view}")) {
            img src=(format!("/materials/{material}/views/{view}/thumbnail.png"))
                alt=(format!("Material {material}, view {view}")) loading="lazy"
                width="112" height="112";
            span.name { (material) " " span.soft { (entry.split) } }
            @if sorted_by.name != "material" {
                span.soft {
                    (sorted_by.label) " "
                    (match (sorted_by.of)(entry) {
                        Some(value) => significant(value),
                        None => "unknown".to_owned(),
                    })
                }
            } @else {
                span.soft {
                    "R " (significant(entry.labels[0])) ", A " (significant(entry.labels[1]))
                }
            }
        }
    }
}

fn form(shown: &Shown<'_>, filter: &Filter) -> Markup {
    let specification = &shown.site.specification;
    let condition = filter.condition.as_ref().map(|(text, _)| text.as_str());
    html! {
        form.filter method="get" action="/materials" {
            div.row {
                label { "Sort by "
                    select name="sort" {
                        @for field in &FIELDS {
                            @for (minus, order) in [("", "lowest first"), ("-", "highest first")] {
                                @let value = format!("{minus}{}", field.name);
                                option value=(value) selected[filter.sort.text() == value] {
                                    (field.label) ", " (order)
                                }
                            }
                        }
                    }
                }
                label { "View "
                    select name="view" {
                        @for view in 0..specification.views.len() as u32 {
                            option value=(view) selected[filter.view == view] { (view) }
                        }
                    }
                }
                label { "Split "
                    select name="split" {
                        option value="" selected[filter.split.is_none()] { "all" }
                        @for split in [Split::Train, Split::Validation, Split::Test] {
                            option value=(split) selected[filter.split == Some(split)] { (split) }
                        }
                    }
                }
                button type="submit" { "Show" }
                a href="/materials" { "Reset" }
            }
            details open[filter.is_narrow()] {
                summary { "Filter" }
                div.bounds {
                    @for field in &FIELDS { (bounds(filter, field)) }
                }
                label.condition { "Condition on labels "
                    input type="text" name="where" value=[condition] size="40"
                        placeholder="roughness < 20 and rgb0_lab_0 > 50";
                }
            }
        }
    }
}

fn bounds(filter: &Filter, field: &crate::catalogue::Field) -> Markup {
    let [low, high] = filter.bounds(field);
    html! {
        fieldset {
            legend { (field.title()) }
            @for (side, bound, label) in [("min", low, "at least"), ("max", high, "at most")] {
                input type="text" inputmode="decimal" name=(format!("{}_{side}", field.name))
                    value=[bound] placeholder=(label) aria-label=(format!("{} {label}", field.label))
                    size="8";
            }
        }
    }
}

/// Links to the other pages.
fn pager(filter: &Filter, pages: usize) -> Markup {
    let link = |page: usize| {
        let mut other = filter.clone();
        other.page = page;
        format!("/materials?{}", other.query())
    };
    html! {
        @if pages > 1 {
            nav.pager aria-label="Pages of materials" {
                @if filter.page > 1 {
                    a href=(link(1)) { "First" }
                    a rel="prev" href=(link(filter.page - 1)) { "Previous" }
                }
                span { "Page " (filter.page) " of " (pages) }
                @if filter.page < pages {
                    a rel="next" href=(link(filter.page + 1)) { "Next" }
                    a href=(link(pages)) { "Last" }
                }
            }
        }
    }
}
