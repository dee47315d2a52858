//! What operators do: a page that says what will happen, and a button that does it.

use super::{Shown, layout};
use crate::problem::Problem;
use coordinator::ControlService;
use limits::protocol::{NAME_BYTES_MAX, PRIORITY_MAX, REASON_BYTES_MAX};
use maud::{Markup, html};
use proto::{
    BarWorkerRequest, CancelJobsRequest, Control, DrainRequest, JobSelection, JobState,
    JobsChanged, MaterialRange, PauseRequest, PrioritizeJobsRequest, ResumeRequest,
    RetryJobsRequest, UnbarWorkerRequest,
};
use tonic::Request;
use url::form_urlencoded;

/// Something that an operator does to a farm.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Gives a material, or all that are quarantined, another chance.
    Retry(Option<u32>),
    /// Takes a material out of the set.
    Cancel(u32),
    /// Moves a material forward or back.
    Prioritize(u32, i32),
    /// Gives a worker no more jobs.
    Block(String, String),
    /// Lets a worker work again.
    Unblock(String),
    /// Hands out no jobs.
    Pause,
    /// Hands out jobs again.
    Resume,
    /// Hands out no jobs, and lets those under way end.
    Drain,
}

/// A link to the page that asks for confirmation.
pub fn link(label: &str, action: &str, about: &[(&str, &str)]) -> Markup {
    let mut query = form_urlencoded::Serializer::new(String::new());
    query.append_pair("do", action).extend_pairs(about);
    // Says of what, for those who hear links without what stands around them.
    let what: Vec<&str> = about.iter().map(|(_, value)| *value).collect();
    let spoken = (!what.is_empty()).then(|| format!("{label} {}", what.join(" ")));
    html! {
        a.button href=(format!("/act?{}", query.finish())) aria-label=[spoken] { (label) }
    }
}

impl Action {
    /// Reads a query or a form.
    ///
    /// # Errors
    /// Says what is wrong with it.
    pub fn parse(query: &[u8]) -> Result<Self, Problem> {
        let (mut action, mut material, mut worker) = (String::new(), None, None);
        let (mut priority, mut reason) = (1, "blocked by an operator in the browser".to_owned());
        for (key, value) in form_urlencoded::parse(query) {
            let number = || Problem::bad(format!("{key} is a number, and {value:?} is none"));
            match &*key {
                "do" => action = value.into_owned(),
                "material" => material = Some(value.parse().map_err(|_| number())?),
                "priority" => priority = value.parse().map_err(|_| number())?,
                "worker" if value.len() <= NAME_BYTES_MAX => worker = Some(value.into_owned()),
                "reason" if value.is_empty() => {}
                "reason" if value.len() <= REASON_BYTES_MAX => reason = value.into_owned(),
                _ => {
                    let sentence = format!("{key:?} is no part of an action, or is too long");
                    return Err(Problem::bad(sentence));
                }
            }
        }
        let of_material = || material.ok_or_else(|| Problem::bad("which material?"));
        let of_worker = || worker.clone().ok_or_else(|| Problem::bad("which worker?"));
        Ok(match &*action {
            "retry" => Self::Retry(material),
            "cancel" => Self::Cancel(of_material()?),
            "prioritize" => Self::Prioritize(of_material()?, priority),
            "block" => Self::Block(of_worker()?, reason),
            "unblock" => Self::Unblock(of_worker()?),
            "pause" => Self::Pause,
            "resume" => Self::Resume,
            "drain" => Self::Drain,
            other => return Err(Problem::bad(format!("nothing is called {other:?}"))),
        })
    }

    /// What it is called, and what happens.
    fn told(&self) -> (String, String) {
        let (title, what) = match self {
            Self::Retry(Some(material)) => (
                format!("Retry material {material}"),
                "If it is quarantined or cancelled, its failures are forgotten and it is handed out \
                 again.",
            ),
            Self::Retry(None) => (
                "Retry all quarantined materials".to_owned(),
                "Their failures are forgotten and they are handed out again.",
            ),
            Self::Cancel(material) => (
                format!("Cancel material {material}"),
                "It is not rendered, and a worker that renders it now is told to stop. Retry brings it \
                 back.",
            ),
            Self::Prioritize(material, _) => (
                format!("Prioritize material {material}"),
                "Materials of a higher priority are handed out first; 0 is usual.",
            ),
            Self::Block(worker, _) => (
                format!("Block worker {worker}"),
                "It gets no jobs, and its leases are taken back, until somebody unblocks it.",
            ),
            Self::Unblock(worker) => (format!("Unblock worker {worker}"), "It gets jobs again."),
            Self::Pause => (
                "Pause the farm".to_owned(),
                "No job is handed out until somebody resumes it; jobs under way are finished.",
            ),
            Self::Resume => ("Resume the farm".to_owned(), "Jobs are handed out again."),
            Self::Drain => (
                "Drain the farm".to_owned(),
                "No job is handed out, and workers leave when theirs are done.",
            ),
        };
        (title, what.to_owned())
    }

    /// The page that asks for confirmation.
    pub fn page(&self, shown: &Shown<'_>, query: &str) -> Markup {
        let (title, what) = self.told();
        let pairs = form_urlencoded::parse(query.as_bytes());
        let content = html! {
            h1 { (title) "?" }
            p { (what) }
            form.confirm method="post" action="/act" {
                @for (key, value) in pairs.filter(|(key, _)| key != "priority" && key != "reason") {
                    input type="hidden" name=(key) value=(value);
                }
                @match self {
                    Self::Prioritize(_, priority) => {
                        label for="priority" { "Priority" }
                        input #priority type="number" name="priority" value=(priority)
                            min=(-PRIORITY_MAX) max=(PRIORITY_MAX) required;
                    }
                    Self::Block(..) => {
                        label for="reason" { "Why, for whoever looks later" }
                        input #reason type="text" name="reason" maxlength="200" autocomplete="off";
                    }
                    _ => {}
                }
                button type="submit" { (title) }
                a href="/" { "Leave it as it is" }
            }
        };
        layout::page(shown, None, &title, content)
    }

    /// Does it; returns the page that says so.
    pub async fn execute(
        &self,
        shown: &Shown<'_>,
        control: &ControlService,
    ) -> Result<Markup, Problem> {
        let (title, _) = self.told();
        let came = self.act(control).await?;
        let content = html! {
            h1 { (title) }
            p role="status" { (came) }
            p { a href="/" { "Back to the farm" } " " a href="/jobs" { "Jobs" } " "
                a href="/workers" { "Workers" } }
        };
        Ok(layout::page(shown, None, &title, content))
    }

    async fn act(&self, control: &ControlService) -> Result<String, Problem> {
        match self {
            Self::Retry(material) => {
                let selection = Some(selection(
                    *material,
                    &[JobState::SetAside, JobState::Cancelled],
                ));
                let selection = match material {
                    Some(_) => selection,
                    None => Some(self::selection(None, &[JobState::SetAside])),
                };
                let request = RetryJobsRequest { selection };
                changed(control.retry_jobs(Request::new(request)).await)
            }
            Self::Cancel(material) => {
                let selection = Some(selection(Some(*material), &[]));
                let request = CancelJobsRequest { selection };
                changed(control.cancel_jobs(Request::new(request)).await)
            }
            Self::Prioritize(material, priority) => {
                let request = PrioritizeJobsRequest {
                    selection: Some(selection(Some(*material), &[])),
                    priority: *priority,
                };
                changed(control.prioritize_jobs(Request::new(request)).await)
            }
            Self::Block(name, reason) => {
                let request = BarWorkerRequest {
                    name: name.clone(),
                    reason: reason.clone(),
                };
                let blocked = control.bar_worker(Request::new(request)).await;
                let back = blocked
                    .map_err(Problem::from)?
                    .into_inner()
                    .leases_taken_back;
                Ok(format!("Blocked; {back} of its leases were taken back."))
            }
            Self::Unblock(name) => {
                let request = UnbarWorkerRequest { name: name.clone() };
                let unblocked = control.unbar_worker(Request::new(request)).await;
                unblocked.map_err(Problem::from)?;
                Ok("Unblocked.".to_owned())
            }
            Self::Pause => mode(control.pause(Request::new(PauseRequest {})).await),
            Self::Resume => mode(control.resume(Request::new(ResumeRequest {})).await),
            Self::Drain => mode(control.drain(Request::new(DrainRequest {})).await),
        }
    }
}

fn selection(material: Option<u32>, states: &[JobState]) -> JobSelection {
    let range = |material| MaterialRange {
        first: material,
        last: material,
    };
    JobSelection {
        ranges: material.map(range).into_iter().collect(),
        states: states.iter().map(|state| (*state).into()).collect(),
    }
}

fn changed(answer: Result<tonic::Response<JobsChanged>, tonic::Status>) -> Result<String, Problem> {
    let ranges = answer.map_err(Problem::from)?.into_inner().changed;
    let count: u64 = ranges
        .iter()
        .map(|range| u64::from(range.last - range.first) + 1)
        .sum();
    Ok(match count {
        0 => "Nothing changed: no material is in a state in which this can be done.".to_owned(),
        1 => "1 material changed.".to_owned(),
        count => format!("{count} materials changed."),
    })
}

fn mode(
    answer: Result<tonic::Response<proto::ModeChanged>, tonic::Status>,
) -> Result<String, Problem> {
    let repeated = answer.map_err(Problem::from)?.into_inner().repeated;
    Ok(if repeated {
        "It was so already."
    } else {
        "Done."
    }
    .to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_action_says_of_what() {
        let parse = |query: &str| Action::parse(query.as_bytes());
        assert_eq!(parse("do=retry&material=5"), Ok(Action::Retry(Some(5))));
        assert_eq!(parse("do=retry"), Ok(Action::Retry(None)));
        assert_eq!(
            parse("do=prioritize&material=5&priority=-3"),
            Ok(Action::Prioritize(5, -3))
        );
        let block = Action::Block("a b<".to_owned(), "slow".to_owned());
        assert_eq!(parse("do=block&worker=a+b%3C&reason=slow"), Ok(block));
        for query in [
            "",
            "do=delete",
            "do=cancel",
            "do=cancel&material=-1",
            "do=cancel&material=4294967296",
            "do=block",
            "do=pause&x=1",
        ] {
            assert!(parse(query).is_err(), "{query}");
        }
        let long = format!("do=unblock&worker={}", "x".repeat(NAME_BYTES_MAX + 1));
        assert!(parse(&long).is_err());
    }

    proptest! {
        #[test]
        fn no_form_makes_it_panic(form in "(do=|material=|worker=|&|%|[a-z0-9]|\\PC){0,60}") {
            let _ = Action::parse(form.as_bytes());
        }
    }
}
