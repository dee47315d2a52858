//! The workers of a farm.

use super::{
    Shown, action, layout,
    numbers::{grouped, span},
};
use crate::access::Visitor;
use maud::{Markup, html};
use proto::WorkerDetail;

/// The page.
pub fn page(shown: &Shown<'_>, workers: &[WorkerDetail]) -> Markup {
    let visitor = shown.visitor.unwrap_or(Visitor::Reader);
    let content = html! {
        h1 { "Workers" }
        @if workers.is_empty() {
            p.empty { "No worker has been there." }
        } @else {
            p.count {
                @match workers.len() {
                    1 => { "1 worker." }
                    count => { (grouped(count as u64)) " workers, those first that are there." }
                }
            }
            (table(workers, visitor))
        }
    };
    layout::page(shown, Some(layout::Tab::Workers), "Workers", content)
}

/// A row for each worker.
pub fn table<'a>(workers: impl IntoIterator<Item = &'a WorkerDetail>, visitor: Visitor) -> Markup {
    let acts = visitor == Visitor::Operator;
    html! {
        div.wide tabindex="0" role="region" aria-label="Workers" {
            table {
                thead {
                    tr {
                        th scope="col" { "Worker" } th scope="col" { "State" }
                        th.number scope="col" { "Leases" } th.number scope="col" { "Completed" }
                        th.number scope="col" { "Failures" } th.number scope="col" { "Leases lost" }
                        @if acts { th scope="col" { "Action" } }
                    }
                }
                tbody {
                    @for worker in workers {
                        tr {
                            td.text { (worker.name) }
                            td.text { (state(worker)) }
                            td.number { (worker.leases) }
                            td.number { (grouped(worker.materials_completed)) }
                            td.number { (worker.failures) }
                            td.number { (worker.leases_lost) }
                            @if acts {
                                td { @if worker.barred.is_empty() {
                                    (action::link("Block", "block", &[("worker", &worker.name)]))
                                } @else {
                                    (action::link("Unblock", "unblock", &[("worker", &worker.name)]))
                                } }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn state(worker: &WorkerDetail) -> String {
    if !worker.barred.is_empty() {
        format!("blocked: {}", worker.barred)
    } else if worker.sessions == 0 {
        "gone".to_owned()
    } else if worker.silent_ms > 10_000 {
        format!("silent for {}", span(worker.silent_ms as f64 / 1e3))
    } else {
        "there".to_owned()
    }
}
