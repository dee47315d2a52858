//! A selection of jobs looked through window by window, so that no statement looks at more than a
//! few thousand, however many there are and however few are wanted.

use super::{
    connecting::query,
    fault::Fault,
    rows::{number, stage_name},
};
use deadpool_postgres::Transaction;
use jobqueue::{Selection, Stage};

/// Part of a selection: its ranges within a few materials, and its stages by name.
pub(super) struct Window {
    pub firsts: Vec<i64>,
    pub lasts: Vec<i64>,
    pub stages: Vec<&'static str>,
    /// Where the next one begins.
    pub next: Option<u32>,
}

/// All stages, in the order of the database's columns.
const STAGES: [Stage; 6] = [
    Stage::Pending,
    Stage::Leased,
    Stage::Completed,
    Stage::Disputed,
    Stage::Quarantined,
    Stage::Cancelled,
];

impl Window {
    /// The part of a selection that begins at or after a material; `last` is the last material of
    /// the set.
    pub fn of(selection: &Selection, from: u32, last: u32) -> Option<Self> {
        let from = selection.first_from(from).filter(|from| *from <= last)?;
        let to = from.saturating_add(limits::DATABASE_WINDOW_MATERIALS - 1);
        let ranges = selection.within(from, to.min(last));
        let next = to
            .checked_add(1)
            .and_then(|next| selection.first_from(next));
        Some(Self {
            firsts: ranges.iter().map(|(first, _)| i64::from(*first)).collect(),
            lasts: ranges.iter().map(|(_, last)| i64::from(*last)).collect(),
            stages: stages(selection),
            next: next.filter(|next| *next <= last),
        })
    }
}

/// The names of a selection's stages.
pub(super) fn stages(selection: &Selection) -> Vec<&'static str> {
    let stages = STAGES.iter().filter(|stage| selection.has_stage(**stage));
    stages.map(|stage| stage_name(*stage)).collect()
}

/// Whether the database lists all jobs of a selection's stages apart.
pub(super) fn is_apart(selection: &Selection) -> bool {
    let apart = [Stage::Disputed, Stage::Quarantined, Stage::Cancelled];
    let stages = selection.stages();
    !stages.is_empty() && stages.iter().all(|stage| apart.contains(stage))
}

/// The last material of the set.
pub(super) async fn last_material(transaction: &Transaction<'_>) -> Result<Option<u32>, Fault> {
    let rows = query(transaction, include_str!("sql/last_material.sql"), &[]).await?;
    rows.first().map(|row| number(row.get(0))).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_together_are_the_selection() {
        let last = 3 * limits::DATABASE_WINDOW_MATERIALS;
        let ranges = vec![(0, 5), (100, 4500), (last - 3, u32::MAX)];
        for ranges in [ranges, Vec::new()] {
            let selection = Selection::new(ranges, Vec::new());
            let mut found = Vec::new();
            let mut from = Some(0);
            while let Some(start) = from {
                let window = Window::of(&selection, start, last).unwrap();
                for (first, last) in window.firsts.iter().zip(&window.lasts) {
                    found.extend(*first..=*last);
                }
                assert!(window.next.is_none_or(|next| next > start));
                from = window.next;
            }
            let expected = (0..=last).filter(|material| selection.has_material(*material));
            assert_eq!(found, expected.map(i64::from).collect::<Vec<_>>());
        }
        let beyond = Selection::new(vec![(last + 1, last + 9)], Vec::new());
        assert!(Window::of(&beyond, 0, last).is_none());
    }
}
