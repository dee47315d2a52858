//! The page of the command line.

use super::markdown::{head, prose};
use clap::{Arg, Command};
use std::fmt::Write;

const INTRODUCTION: &str = "\
Every command explains itself with `--help`. This page has the same texts. The commands `train`, \
`evaluate`, `estimate` and `dataset observability` need the feature `training` of the build. Stores in \
PostgreSQL and images in buckets need the feature `cluster`.

";

/// The page of the whole command line.
pub fn page(mut cli: Command) -> String {
    cli.build();
    let mut page = head("The command line") + INTRODUCTION;
    if let Some(about) = cli.get_after_help() {
        let _ = write!(page, "{}\n\n", prose(&about.to_string()));
    }
    page += "## Options of every command\n\n";
    for argument in shown(&cli).filter(|argument| argument.is_global_set()) {
        page += &item(argument);
    }
    page.push('\n');
    for command in subcommands(&cli) {
        describe(command, 2, &mut page);
    }
    while page.ends_with("\n\n") {
        page.pop();
    }
    page
}

/// A command as a section, with its subcommands one level below.
fn describe(command: &Command, level: usize, page: &mut String) {
    let name = command.get_bin_name().unwrap_or(command.get_name());
    let _ = write!(page, "{} {name}\n\n", "#".repeat(level));
    let about = command.get_long_about().or(command.get_about());
    if let Some(about) = about {
        let about = about.to_string();
        let _ = write!(page, "{}\n\n", prose(&sentences(&about)));
    }
    if command.get_subcommands().next().is_none() {
        page.push_str(&usage(command));
        page.push_str(&arguments(command));
    }
    for command in subcommands(command) {
        describe(command, level + 1, page);
    }
}

/// Clap's summaries have no full stop. The first line of a description gets one.
fn sentences(about: &str) -> String {
    match about.split_once("\n\n") {
        Some((first, rest)) => format!("{}\n\n{rest}", stopped(first)),
        None => stopped(about),
    }
}

fn stopped(text: &str) -> String {
    match text.ends_with(['.', '!', '?', ':']) {
        true => text.to_owned(),
        false => format!("{text}."),
    }
}

fn usage(command: &Command) -> String {
    let usage = command.clone().render_usage().to_string();
    let usage = usage.trim_start_matches("Usage:").trim();
    format!("```text\n{usage}\n```\n\n")
}

/// The arguments and options as lists, each under its heading.
fn arguments(command: &Command) -> String {
    let mut out = String::new();
    let mut headings: Vec<&str> = Vec::new();
    let own = || shown(command).filter(|argument| !argument.is_global_set());
    for argument in own() {
        let heading = heading(argument);
        if !headings.contains(&heading) {
            headings.push(heading);
        }
    }
    headings.sort_by_key(|heading| *heading != "Arguments");
    for title in headings {
        let _ = write!(out, "{title}:\n\n");
        for argument in own().filter(|argument| heading(argument) == title) {
            out += &item(argument);
        }
        out.push('\n');
    }
    out
}

fn heading(argument: &Arg) -> &str {
    let place = if argument.is_positional() {
        "Arguments"
    } else {
        "Options"
    };
    argument.get_help_heading().unwrap_or(place)
}

/// An argument as an item of a list: how it is written, what it means, and its values.
fn item(argument: &Arg) -> String {
    let help = argument.get_long_help().or(argument.get_help());
    let help = help.map(|help| help.to_string()).unwrap_or_default();
    let (help, default) = without_default(&help);
    let help = prose(&stopped(help)).replace("\n\n", " ");
    let mut text = format!("- `{}`: {help}", written(argument));
    if let Some(default) = default {
        let _ = write!(text, " Default: {}.", prose(default));
    }
    let takes_values = argument.get_action().takes_values();
    let defaults = argument.get_default_values();
    if takes_values && !defaults.is_empty() && !argument.is_hide_default_value_set() {
        let defaults: Vec<_> = defaults
            .iter()
            .map(|value| value.to_string_lossy())
            .collect();
        let _ = write!(text, " Default: `{}`.", defaults.join(" "));
    }
    if let Some(variable) = argument.get_env() {
        let _ = write!(text, " Environment: `{}`.", variable.to_string_lossy());
    }
    text.push('\n');
    if takes_values {
        let values = argument.get_possible_values();
        for value in values.iter().filter(|value| !value.is_hide_set()) {
            let help = value.get_help().map(|help| prose(&help.to_string()));
            let help = help.map_or(String::new(), |help| format!(": {}", stopped(&help)));
            let _ = writeln!(text, "  - `{}`{help}", value.get_name());
        }
    }
    text
}

/// A help text, and the default in brackets at its end: one that depends on something, which clap
/// cannot know.
fn without_default(help: &str) -> (&str, Option<&str>) {
    let parts = help
        .strip_suffix(']')
        .and_then(|help| help.rsplit_once(" [default: "));
    parts.map_or((help, None), |(help, default)| (help, Some(default)))
}

/// An argument as it is typed: `-n, --name <NAME>`, `<FILE>...`.
fn written(argument: &Arg) -> String {
    // An argument's own text has the brackets and dots of its values.
    let full = argument.to_string();
    match argument.get_short() {
        Some(short) if argument.get_long().is_some() => format!("-{short}, {full}"),
        _ => full,
    }
}

/// The arguments that --help shows, less those that clap adds.
fn shown(command: &Command) -> impl Iterator<Item = &Arg> {
    let arguments = command.get_arguments();
    arguments.filter(|argument| {
        let added = ["help", "version"].contains(&argument.get_id().as_str());
        !argument.is_hide_set() && !added
    })
}

fn subcommands(command: &Command) -> impl Iterator<Item = &Command> {
    let all = command.get_subcommands();
    all.filter(|command| !command.is_hide_set() && command.get_name() != "help")
}
