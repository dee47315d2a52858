//! The jobs of a farm by state, page after page.

use super::{Shown, action, layout};
use crate::{access::Visitor, problem::Problem};
use coordinator::ControlService;
use limits::web::{JOBS_A_PAGE, JOBS_SEARCH};
use maud::{Markup, html};
use proto::{Check, Control, JobDetail, JobSelection, JobState, ListJobsRequest, ListJobsResponse};
use std::time::Instant;
use url::form_urlencoded;

/// Which jobs an address asks for.
pub struct Wanted {
    state: Option<State>,
    from: u32,
}

/// A state with its name in addresses.
type State = (&'static str, JobState);

const STATES: [State; 6] = [
    ("pending", JobState::Pending),
    ("leased", JobState::Leased),
    ("completed", JobState::Completed),
    ("disputed", JobState::Disputed),
    ("quarantined", JobState::SetAside),
    ("cancelled", JobState::Cancelled),
];

impl Wanted {
    /// Reads the query of an address.
    ///
    /// # Errors
    /// Says what is wrong with it.
    pub fn parse(query: &str) -> Result<Self, Problem> {
        let mut wanted = Self {
            state: None,
            from: 0,
        };
        for (key, value) in form_urlencoded::parse(query.as_bytes()) {
            match &*key {
                _ if value.is_empty() => {}
                "state" => {
                    let state = STATES.into_iter().find(|(name, _)| *name == value);
                    let state = state.ok_or_else(|| {
                        Problem::bad(format!("jobs have no state that is called {value:?}"))
                    })?;
                    wanted.state = Some(state);
                }
                "from" => {
                    let from = value.parse();
                    wanted.from = from.map_err(|_| {
                        Problem::bad(format!(
                            "from is a material's number, and {value:?} is none"
                        ))
                    })?;
                }
                _ => {
                    let sentence = format!("no part of an address is called {key:?}");
                    return Err(Problem::bad(sentence));
                }
            }
        }
        Ok(wanted)
    }

    /// What to ask the coordinator first.
    fn request(&self) -> ListJobsRequest {
        ListJobsRequest {
            selection: Some(JobSelection {
                ranges: Vec::new(),
                states: self
                    .state
                    .iter()
                    .map(|(_, state)| (*state).into())
                    .collect(),
            }),
            from: self.from,
            jobs_max: JOBS_A_PAGE,
        }
    }

    /// Asks the coordinator, again and again where it found too few, until the page is full, all jobs
    /// were looked through, or the time for a page is over.
    ///
    /// # Errors
    /// When the coordinator has no answer.
    pub async fn ask(&self, control: &ControlService) -> Result<ListJobsResponse, Problem> {
        let began = Instant::now();
        let mut request = self.request();
        let mut found = Vec::new();
        loop {
            let answer = control.list_jobs(tonic::Request::new(request.clone()));
            let answer = answer.await.map_err(Problem::from)?.into_inner();
            found.extend(answer.jobs);
            let wanted = JOBS_A_PAGE.saturating_sub(found.len() as u32);
            match answer.next {
                Some(next) if wanted > 0 && began.elapsed() < JOBS_SEARCH => {
                    request.from = next;
                    request.jobs_max = wanted;
                }
                next => return Ok(ListJobsResponse { jobs: found, next }),
            }
        }
    }

    fn address(&self, from: u32) -> String {
        let mut query = form_urlencoded::Serializer::new(String::new());
        if let Some((name, _)) = self.state {
            query.append_pair("state", name);
        }
        query.append_pair("from", &from.to_string());
        format!("/jobs?{}", query.finish())
    }
}

/// The page.
pub fn page(shown: &Shown<'_>, wanted: &Wanted, answer: &ListJobsResponse) -> Markup {
    let acts = shown.visitor == Some(Visitor::Operator);
    let content = html! {
        h1 { "Jobs" }
        form.filter method="get" action="/jobs" {
            div.row {
                label { "State "
                    select name="state" {
                        option value="" selected[wanted.state.is_none()] { "all" }
                        @for (name, _) in STATES {
                            option value=(name)
                                selected[wanted.state.is_some_and(|(other, _)| other == name)] {
                                (name)
                            }
                        }
                    }
                }
                label { "From material "
                    input type="text" inputmode="numeric" name="from" value=(wanted.from) size="8";
                }
                button type="submit" { "Show" }
            }
        }
        (found(wanted, answer, acts))
        nav.pager aria-label="Pages of jobs" {
            @if wanted.from > 0 { a href=(wanted.address(0)) { "First" } }
            @if let Some(next) = answer.next {
                a rel="next" href=(wanted.address(next)) { "Next" }
            }
        }
    };
    layout::page(shown, Some(layout::Tab::Jobs), "Jobs", content)
}

/// The jobs that were found, and whether there may be others.
fn found(wanted: &Wanted, answer: &ListJobsResponse, acts: bool) -> Markup {
    html! {
        @if !answer.jobs.is_empty() { (table(&answer.jobs, acts)) }
        @match (answer.jobs.len(), answer.next) {
            (0, None) => p.empty { "There are no such jobs." },
            (count, Some(next)) if count < JOBS_A_PAGE as usize => p.empty {
                "Materials " (wanted.from) " to " (next - 1) " were looked through. "
                a href=(wanted.address(next)) { "Look further" }
            },
            _ => {}
        }
    }
}

fn table(jobs: &[JobDetail], acts: bool) -> Markup {
    html! {
        div.wide tabindex="0" role="region" aria-label="Jobs" {
            table {
                thead {
                    tr {
                        th.number scope="col" { "Material" } th scope="col" { "State" }
                        th.number scope="col" { "Priority" } th scope="col" { "Worker" }
                        th.number scope="col" { "Views done" } th scope="col" { "Failures" }
                        @if acts { th scope="col" { "Action" } }
                    }
                }
                tbody { @for job in jobs { (row(job, acts)) } }
            }
        }
    }
}

fn row(job: &JobDetail, acts: bool) -> Markup {
    let material = job.material.to_string();
    let of_job: [(&str, &str); 1] = [("material", &material)];
    let state = job.state();
    let can_retry = matches!(state, JobState::SetAside | JobState::Cancelled);
    let can_cancel = matches!(
        state,
        JobState::Pending | JobState::Leased | JobState::SetAside
    );
    html! {
        tr {
            td.number { a href=(format!("/materials/{material}")) { (material) } }
            td.text { (state_name(state)) (check(job)) }
            td.number { (job.priority) }
            td.text { (job.worker) }
            td.number { @if state == JobState::Leased { (job.views_done) } }
            td.text {
                @for failure in &job.failures { div { (failure.worker) ": " (failure.error) } }
                @match job.leases_lost {
                    0 => {}
                    1 => div { "1 lease ran out" },
                    lost => div { (lost) " leases ran out" },
                }
            }
            @if acts {
                td.actions {
                    @if can_retry { (action::link("Retry", "retry", &of_job)) }
                    @if can_cancel {
                        (action::link("Prioritize", "prioritize", &of_job))
                        (action::link("Cancel", "cancel", &of_job))
                    }
                }
            }
        }
    }
}

fn state_name(state: JobState) -> &'static str {
    let found = STATES.into_iter().find(|(_, other)| *other == state);
    found.map_or("unknown", |(name, _)| name)
}

fn check(job: &JobDetail) -> String {
    match job.check() {
        Check::Due => ", to be rendered again".to_owned(),
        Check::UnderWay => ", being rendered again".to_owned(),
        Check::Agreed => ", second rendering agreed".to_owned(),
        _ if !job.contradicted_by.is_empty() => {
            format!(", contradicted by {}", job.contradicted_by)
        }
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_whose_time_was_over_does_not_say_that_there_are_none() {
        let wanted = Wanted::parse("state=leased&from=3").expect("an address");
        let nothing = |next| ListJobsResponse {
            jobs: Vec::new(),
            next,
        };
        let said = found(&wanted, &nothing(Some(64_000)), false).into_string();
        assert!(
            said.contains("Materials 3 to 63999 were looked through."),
            "{said}"
        );
        assert!(said.contains("/jobs?state=leased&amp;from=64000"), "{said}");
        let said = found(&wanted, &nothing(None), false).into_string();
        assert!(said.contains("There are no such jobs."), "{said}");
    }
}
