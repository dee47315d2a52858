//! The farm at work. Each section is a fragment that is sent anew when it changes.

use super::{
    Shown, action, layout,
    numbers::{bytes, grouped, significant, span},
    workers,
};
use crate::{
    access::Visitor,
    live::{Fragments, Seen},
    plots::line::{Line, Point},
    site::Site,
};
use maud::{Markup, html};
use proto::{Counts, Mode, WorkerDetail};
use std::time::Instant;

/// Workers on the page; all of them are on a page of their own.
const WORKERS_SHOWN: usize = 12;

/// The page.
pub fn page(shown: &Shown<'_>, seen: &Seen) -> Markup {
    let visitor = shown.visitor.unwrap_or(Visitor::Reader);
    let fragments = fragments(shown.site, seen, visitor);
    let part = |name: &str| fragments.get(name).map(String::as_str).unwrap_or_default();
    let section = |name: &str, title: &str| {
        html! {
            section aria-label=(title) {
                h2 { (title) }
                div id=(format!("live-{name}")) data-live=(name) { (maud::PreEscaped(part(name))) }
            }
        }
    };
    let content = html! {
        h1 { "Farm" }
        p #connection.problem role="status" hidden {
            "Disconnected: this is how the farm was. The page goes on by itself."
        }
        div #live-progress data-live="progress" { (maud::PreEscaped(part("progress"))) }
        (section("trouble", "Trouble"))
        div.columns {
            (section("rate", "Rate"))
            (section("workers", "Workers"))
        }
        (section("last", "Last images"))
        (section("events", "Events"))
    };
    layout::page(shown, Some(layout::Tab::Farm), "Farm", content)
}

/// The page's sections for a visitor.
pub fn fragments(site: &Site, seen: &Seen, visitor: Visitor) -> Fragments {
    let sections: [(&str, Markup); 6] = [
        ("progress", progress(site, seen, visitor)),
        ("trouble", trouble(seen, visitor)),
        ("rate", rate(seen)),
        ("workers", workers_there(seen, visitor)),
        ("last", last(site, seen)),
        ("events", events(seen)),
    ];
    let sections = sections.into_iter();
    sections
        .map(|(name, html)| (name, html.into_string()))
        .collect()
}

fn progress(site: &Site, seen: &Seen, visitor: Visitor) -> Markup {
    let status = &seen.status;
    let counts = status.counts.unwrap_or_default();
    let stored: u64 = site
        .catalogue
        .listing()
        .entries
        .iter()
        .map(|entry| entry.bytes)
        .sum();
    let mode = match status.mode() {
        Mode::Paused => "paused",
        Mode::Draining => "draining",
        _ if status.finished => "finished",
        _ => "running",
    };
    html! {
        p.state {
            strong { (mode) } ", " (grouped(counts.completed.into())) " of "
            (grouped(counts.materials.into())) " materials, " (grouped(counts.images)) " images"
        }
        progress max=(counts.materials.max(1)) value=(counts.completed)
            aria-label="Completed materials" {}
        dl.figures {
            (figure("Images a second, last minute", significant(status.images_per_second)))
            (figure("Time left", time_left(seen, &counts)))
            (figure("Leased", grouped(counts.leased.into())))
            (figure("Pending", grouped(counts.pending.into())))
            (figure("To render again", grouped(counts.checks.into())))
            (figure("Workers", grouped(counts.workers.into())))
            (figure("Images in the store", bytes(stored)))
            @if let Some(free) = site.images.free_bytes() {
                (figure("Free on its disk", bytes(free)))
            }
        }
        @if visitor == Visitor::Operator && !status.finished {
            p.actions {
                @if status.mode() == Mode::Running {
                    (action::link("Pause", "pause", &[]))
                    (action::link("Drain", "drain", &[]))
                } @else {
                    (action::link("Resume", "resume", &[]))
                }
            }
        }
    }
}

fn figure(label: &str, value: String) -> Markup {
    html! { div { dt { (label) } dd { (value) } } }
}

/// How long the rest takes at the rate of the last hour: an interval that covers the mean rate 19
/// times of 20, if minutes are like each other.
fn time_left(seen: &Seen, counts: &Counts) -> String {
    let views = u64::from(seen.status.views);
    let images = u64::from(counts.pending + counts.leased) * views;
    if images == 0 {
        return "nothing is left".to_owned();
    }
    let left = images as f64;
    match seen.history.rate(Instant::now()) {
        Some(rate) if rate.mean > 2.0 * rate.error => {
            let [soon, late] = [rate.mean + 2.0 * rate.error, rate.mean - 2.0 * rate.error];
            format!("{} to {}", span(left / soon), span(left / late))
        }
        _ if seen.status.images_per_second > 0.0 => {
            format!("about {}", span(left / seen.status.images_per_second))
        }
        _ => "unknown: nothing was completed lately".to_owned(),
    }
}

/// Everything that somebody should look at, with what can be done about it.
fn trouble(seen: &Seen, visitor: Visitor) -> Markup {
    let status = &seen.status;
    let counts = status.counts.unwrap_or_default();
    let blocked = seen
        .workers
        .iter()
        .filter(|worker| !worker.barred.is_empty());
    let blocked: Vec<&WorkerDetail> = blocked.take(WORKERS_SHOWN).collect();
    let acts = visitor == Visitor::Operator;
    html! {
        @if counts.set_aside == 0 && counts.disputed == 0 && blocked.is_empty() {
            p.empty { "None." }
        }
        @if counts.set_aside > 0 {
            h3 { (grouped(counts.set_aside.into())) " quarantined" }
            ul.trouble {
                @for one in &status.set_aside {
                    li {
                        "Material " (one.material) ": " (one.errors.last().map_or("", |error| error))
                        @if acts {
                            " " (action::link("Retry", "retry", &[("material", &one.material.to_string())]))
                        }
                    }
                }
            }
            @if acts { p.actions { (action::link("Retry all quarantined", "retry", &[])) } }
        }
        @if counts.disputed > 0 {
            h3 { (grouped(counts.disputed.into())) " disputed" }
            ul.trouble {
                @for one in &status.disputed {
                    li { "Material " (one.material) ": " (one.contradicted_by) " contradicts "
                         (one.worker) }
                }
            }
        }
        @if !blocked.is_empty() {
            h3 { (grouped(counts.workers_barred.into())) " blocked" }
            ul.trouble {
                @for worker in blocked {
                    li {
                        (worker.name) ": " (worker.barred)
                        @if acts {
                            " " (action::link("Unblock", "unblock", &[("worker", &worker.name)]))
                        }
                    }
                }
            }
        }
    }
}

fn rate(seen: &Seen) -> Markup {
    let points = seen.history.points(Instant::now());
    if points.len() < 2 {
        return html! { p.empty { "The plot begins after two whole minutes." } };
    }
    let points = points
        .into_iter()
        .map(|(ago, rate)| Point { x: -ago, y: rate });
    Line {
        description: "Images a second over the last hour",
        x_axis: "minutes ago",
        y_axis: "images a second",
    }
    .draw(&points.collect::<Vec<_>>())
}

fn workers_there(seen: &Seen, visitor: Visitor) -> Markup {
    let there = seen.workers.iter().filter(|worker| worker.sessions > 0);
    let there: Vec<&WorkerDetail> = there.collect();
    html! {
        @if there.is_empty() {
            p.empty { "No worker is there." }
        } @else {
            (workers::table(there.iter().copied().take(WORKERS_SHOWN), visitor))
        }
        p { a href="/workers" { "All workers" } }
    }
}

/// A picture of each of the last materials.
fn last(site: &Site, seen: &Seen) -> Markup {
    let listing = site.catalogue.listing();
    let is_there = |material: &&u32| {
        let found = listing
            .entries
            .binary_search_by_key(*material, |entry| entry.material);
        found.is_ok()
    };
    let materials: Vec<u32> = seen
        .history
        .completed
        .iter()
        .filter(is_there)
        .copied()
        .collect();
    let views = site.specification.views.len() as u32;
    html! {
        @if materials.is_empty() {
            p.empty { "None since this page's server started." }
        }
        ul.grid {
            @for material in materials {
                // Another view for another material, so that many kinds are seen.
                @let view = material % views;
                li {
                    a.card href=(format!("/materials/{material}?view={view}")) {
                        img src=(format!("/materials/{material}/views/{view}/thumbnail.png"))
                            alt=(format!("Material {material}, view {view}")) width="112" height="112";
                        span.name { (material) }
                        span.soft { "view " (view) }
                    }
                }
            }
        }
    }
}

fn events(seen: &Seen) -> Markup {
    html! {
        @if seen.history.events.is_empty() {
            p.empty { "None since this page's server started." }
        } @else {
            div.wide tabindex="0" role="region" aria-label="Events" {
                table {
                    thead { tr { th scope="col" { "Time, UTC" } th scope="col" { "Event" }
                                 th scope="col" { "Material" } th scope="col" { "Worker" }
                                 th scope="col" { "" } } }
                    tbody {
                        @for event in &seen.history.events {
                            tr {
                                td { (clock(event.unix_ms)) }
                                td { (words(&event.kind)) }
                                td { @if let Some(material) = event.material {
                                    a href=(format!("/materials/{material}")) { (material) }
                                } }
                                td { (event.worker) }
                                td.text { (event.text) }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// The protocol's older words for two kinds of events, as people read them now.
fn words(kind: &str) -> &str {
    match kind {
        "barred" => "blocked",
        "unbarred" => "unblocked",
        "check agreed" => "second rendering agreed",
        kind => kind,
    }
}

fn clock(unix_ms: u64) -> String {
    let seconds = unix_ms / 1_000 % 86_400;
    let [hours, minutes] = [seconds / 3_600, seconds / 60 % 60];
    format!("{hours:02}:{minutes:02}:{:02}", seconds % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_read_well() {
        assert_eq!(clock(1_764_028_799_999), "23:59:59");
    }
}
