//! Random names for leases and workers.

use limits::protocol::TOKEN_BYTES;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use std::fmt;

macro_rules! random_name {
    ($(#[$documentation:meta])* $name:ident) => {
        $(#[$documentation])*
        #[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub struct $name([u8; TOKEN_BYTES]);

        impl $name {
            /// The name made of these random bytes.
            pub fn from_bytes(bytes: [u8; TOKEN_BYTES]) -> Self {
                Self(bytes)
            }

            /// The name that a message carries; `None` unless it has the right length.
            pub fn from_message(bytes: &[u8]) -> Option<Self> {
                Some(Self(bytes.try_into().ok()?))
            }

            /// The bytes that a message carries.
            pub fn to_message(self) -> Vec<u8> {
                self.0.to_vec()
            }
        }

        /// The first eight digits: enough to tell one from another, too few to use.
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0[..4].iter().try_for_each(|byte| write!(f, "{byte:02x}"))
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{self}..")
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(&format!("{:032x}", u128::from_be_bytes(self.0)))
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let digits = String::deserialize(deserializer)?;
                // from_str_radix alone would take a sign.
                if digits.len() != 2 * TOKEN_BYTES || digits.starts_with('+') {
                    return Err(de::Error::custom("not 32 hexadecimal digits"));
                }
                u128::from_str_radix(&digits, 16)
                    .map(|number| Self(number.to_be_bytes()))
                    .map_err(|_| de::Error::custom("not 32 hexadecimal digits"))
            }
        }
    };
}

random_name! {
    /// Names one lease: whoever shows it holds the lease. 128 random bits that nobody can guess;
    /// never printed whole.
    Token
}

random_name! {
    /// Names one worker, from its registration until it takes leave.
    WorkerId
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_survives_the_ledger_and_is_never_printed_whole() {
        let token = Token::from_bytes(*b"0123456789abcdef");
        let json = serde_json::to_string(&token).unwrap();
        assert_eq!(serde_json::from_str::<Token>(&json).unwrap(), token);
        assert_eq!(Token::from_message(&token.to_message()), Some(token));
        assert_eq!(format!("{token}"), "30313233");
        assert_eq!(format!("{token:?}"), "30313233..");
        assert_eq!(Token::from_message(b"short"), None);
        for bad in [
            "\"\"",
            "\"12\"",
            "\"+0313233343536373839616263646566\"",
            "7",
        ] {
            assert!(serde_json::from_str::<Token>(bad).is_err(), "{bad}");
        }
    }
}
