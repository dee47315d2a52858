//! Who a worker is. A worker calls itself what it likes; who answers for it is told by the
//! credential that let it in.
//!
//! The queue knows a worker by its full name: `CREDENTIAL/NAME` where a credential let it in, and the
//! bare `NAME` where there are none. What concerns honesty (redundant renders, votes, blocks over
//! wrong images) goes by the [`identity`] of a full name: `CREDENTIAL/`, or the bare name. What
//! concerns a machine (failures, lost leases) goes by the full name.
//!
//! A bare name that holds a slash is written with one more at its start, so that nobody can take on
//! a credential's identity by what they call themselves.

/// The credential whose holder is the operator: its rendering decides a dispute, and it gets no
/// other work. No worker's credential can have this name.
pub const OPERATOR: &str = "operator";

/// The longest name of a credential.
pub const CREDENTIAL_NAME_BYTES_MAX: usize = 64;

/// Whether a credential can have this name: 1 to 64 letters, digits, dots, hyphens and underscores.
pub fn is_credential_name(name: &str) -> bool {
    let of_a_name = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
    (1..=CREDENTIAL_NAME_BYTES_MAX).contains(&name.len()) && name.bytes().all(of_a_name)
}

/// The full name of a worker that calls itself `name`.
pub fn full_name(credential: Option<&str>, name: &str) -> String {
    match credential {
        Some(credential) => format!("{credential}/{name}"),
        None if name.contains('/') => format!("/{name}"),
        None => name.to_owned(),
    }
}

/// Who answers for a worker of this full name. The identity of an identity is itself.
pub fn identity(full_name: &str) -> &str {
    credential(full_name).map_or(full_name, |credential| &full_name[..=credential.len()])
}

/// The credential in a full name or identity, if there is one.
pub fn credential(full_name: &str) -> Option<&str> {
    let slash = full_name.find('/').filter(|slash| *slash > 0)?;
    Some(&full_name[..slash])
}

/// Whether whoever bears this full name is the operator.
pub fn is_operator(full_name: &str) -> bool {
    credential(full_name) == Some(OPERATOR)
}

/// Whether `key`, a full name or an identity, means the worker of this full name.
pub fn means(key: &str, full_name: &str) -> bool {
    key == full_name || key == identity(full_name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_credential_answers_for_all_its_names() {
        let names = ["node-1", "node/2", "/", "operator/x"];
        for name in names {
            let full = full_name(Some("alice"), name);
            assert_eq!(identity(&full), "alice/");
            assert_eq!(credential(&full), Some("alice"));
            assert!(means("alice/", &full) && means(&full, &full));
            assert!(!means("alice/", &full_name(Some("alice2"), name)));
        }
        assert!(is_operator(&full_name(Some(OPERATOR), "me")));
        for name in ["operator", "operator/", "operator/me", "/operator/me"] {
            assert!(!is_operator(&full_name(None, name)), "{name}");
        }
    }

    proptest! {
        /// Whatever a worker without a credential calls itself, it is nobody else.
        #[test]
        fn a_bare_name_takes_on_no_identity(name in "[a-b/]{1,6}", other in "[a-b/]{1,6}") {
            let full = full_name(None, &name);
            prop_assert_eq!(credential(&full), None);
            prop_assert_eq!(identity(&full), full.as_str());
            let of_another = full_name(Some("a"), &other);
            prop_assert_ne!(full.as_str(), identity(&of_another));
            prop_assert_eq!(full == full_name(None, &other), name == other);
        }
    }
}
