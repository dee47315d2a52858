//! Where and how a coordinator serves.

use crate::security::Security;
use jobqueue::Policy;
use std::net::{Ipv4Addr, SocketAddr};

/// Where and how a coordinator serves.
#[derive(Clone, Debug)]
pub struct Options {
    /// The address to listen on; port 0 takes a free one.
    pub listen: SocketAddr,
    /// What protects it.
    pub security: Security,
    /// Whether an address that other machines reach may be served without that.
    pub insecure: bool,
    /// Where to serve Prometheus metrics, over plain HTTP and to everybody; nowhere unless asked.
    pub metrics: Option<SocketAddr>,
    /// The queue's limits, but for those that say who is believed.
    pub policy: Policy,
    /// Room that stays free on the disk of the store's folder, bytes: with less no job is handed out
    /// and no image taken in, and [`limits::DISK_RESERVE_FOR_RECORDS_BYTES`] below it nothing is
    /// recorded, until there is room again.
    pub disk_reserve_bytes: u64,
    /// Room for images that are accepted and not yet completed, and for those that their jobs still
    /// send, bytes.
    pub staged_bytes_max: u64,
    /// Of a million completed materials, how many are rendered a second time by another worker, and
    /// have to come out the same. 0 believes everybody: then newcomers are not looked at, either.
    pub redundant_per_million: u32,
    /// Whether materials that were quarantined get another chance now.
    pub retry_quarantined: bool,
    /// Whether leases of before the start go on. False where nobody can hold one any more, as when
    /// the workers were threads of a process that is gone.
    pub keep_leases: bool,
    /// The task that a test has panic.
    #[cfg(test)]
    pub(crate) panics: Option<&'static str>,
}

impl Options {
    /// Of a million completed materials, how many are rendered a second time: none where all workers
    /// have one credential, since nobody else could render them.
    pub(crate) fn redundant_share(&self) -> u32 {
        let tokens = self.security.tokens.as_ref();
        let alone = tokens.is_some_and(|tokens| tokens.worker_credentials() < 2);
        if alone { 0 } else { self.redundant_per_million }
    }

    /// The queue's limits. Credentials tell who is who, so with them newcomers are looked at, and
    /// everybody's work before the set is finished; a name that anybody can take tells nothing.
    pub(crate) fn queue_policy(&self) -> Policy {
        let distrusts = self.security.tokens.is_some() && self.redundant_share() > 0;
        let (probation, audits) = if distrusts {
            (limits::PROBATION, limits::AUDITS)
        } else {
            (0, 0)
        };
        Policy {
            probation,
            audits,
            ..self.policy
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            listen: (Ipv4Addr::LOCALHOST, 0).into(),
            security: Security::default(),
            insecure: false,
            metrics: None,
            policy: Policy::default(),
            disk_reserve_bytes: limits::DISK_RESERVE_BYTES,
            staged_bytes_max: limits::STAGED_BYTES_MAX,
            redundant_per_million: limits::REDUNDANT_PER_MILLION,
            retry_quarantined: true,
            keep_leases: true,
            #[cfg(test)]
            panics: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_rendered_twice_that_only_one_credential_could_render() {
        let [a, b] = ["a", "b"].map(|letter| letter.repeat(32));
        let with = |tokens: Option<String>| Options {
            security: Security {
                tokens: tokens.map(|tokens| tokens.parse().unwrap()),
                ..Security::default()
            },
            ..Options::default()
        };
        let shares = |options: Options| {
            let policy = options.queue_policy();
            (options.redundant_share(), policy.probation, policy.audits)
        };
        let (share, probation, audits) = (
            limits::REDUNDANT_PER_MILLION,
            limits::PROBATION,
            limits::AUDITS,
        );
        assert_eq!(shares(with(None)), (share, 0, 0));
        let one = format!("worker {a} lab\noperator {b}");
        assert_eq!(shares(with(Some(one))), (0, 0, 0));
        let two = format!("worker {a} lab\nworker {b} guest");
        assert_eq!(shares(with(Some(two))), (share, probation, audits));
    }
}
