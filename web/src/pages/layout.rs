//! What every page has: title, navigation, style and script.

use super::{Shown, assets};
use crate::access::Visitor;
use maud::{DOCTYPE, Markup, html};

/// The pages that the navigation leads to.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Tab {
    Farm,
    Materials,
    Coverage,
    Jobs,
    Workers,
}

impl Tab {
    fn link(self) -> (&'static str, &'static str) {
        match self {
            Self::Farm => ("/farm", "Farm"),
            Self::Jobs => ("/jobs", "Jobs"),
            Self::Workers => ("/workers", "Workers"),
            Self::Materials => ("/materials", "Materials"),
            Self::Coverage => ("/coverage", "Coverage"),
        }
    }
}

/// A page of the site.
pub fn page(shown: &Shown<'_>, tab: Option<Tab>, title: &str, content: Markup) -> Markup {
    let name = &shown.site.specification.name;
    let navigation = html! {
        header.top {
            a.brand href="/" { "brdfarm" }
            span.dataset { (name) }
            nav aria-label="Pages" {
                @for one in tabs(shown) {
                    @let (address, label) = one.link();
                    a href=(address) aria-current=[(tab == Some(*one)).then_some("page")] {
                        (label)
                    }
                }
            }
            @if shown.can_sign_out {
                form.account method="post" action="/logout" {
                    span { @match shown.visitor {
                        Some(Visitor::Operator) => "operator",
                        _ => "reader",
                    } }
                    button type="submit" { "Sign out" }
                }
            }
        }
    };
    let footer = html! {
        footer {
            "Store " code { (shown.site.store) } ", specification "
            code title="The specification's hash" {
                (shortened(&shown.site.specification_hash.to_string()))
            }
        }
    };
    document(&format!("{title} – {name}"), navigation, content, footer)
}

/// A page that tells nothing of the site.
pub fn bare(title: &str, content: Markup) -> Markup {
    let navigation = html! { header.top { a.brand href="/" { "brdfarm" } } };
    let content = html! { h1 { (title) } (content) };
    document(title, navigation, content, html! {})
}

fn document(title: &str, navigation: Markup, content: Markup, footer: Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                link rel="stylesheet" href=(assets::style_address());
                link rel="icon" href="/favicon.svg";
                script src=(assets::script_address()) defer {}
            }
            body {
                a.skip href="#content" { "Skip to content" }
                (navigation)
                main #content { (content) }
                (footer)
            }
        }
    }
}

/// The pages that there are: without a farm, those of the store.
fn tabs(shown: &Shown<'_>) -> &'static [Tab] {
    match shown.site.farm {
        Some(_) => &[
            Tab::Farm,
            Tab::Materials,
            Tab::Coverage,
            Tab::Jobs,
            Tab::Workers,
        ],
        None => &[Tab::Materials, Tab::Coverage],
    }
}

fn shortened(digits: &str) -> &str {
    digits.get(..12).unwrap_or(digits)
}
