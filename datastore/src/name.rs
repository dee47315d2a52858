//! Which store is meant.

use jobstore_postgres::{is_database, without_secrets};
use std::{
    fmt,
    path::{Path, PathBuf},
};

/// The name of a store: a folder, or the URL of a PostgreSQL database. Shown without a password.
#[derive(Clone, PartialEq, Eq)]
pub enum StoreName {
    /// A folder.
    Folder(PathBuf),
    /// A database, as `postgres://USER@HOST:PORT/DATABASE`.
    Database(String),
}

impl StoreName {
    /// A folder, unless the name is a database's.
    pub fn new(name: impl Into<PathBuf>) -> Self {
        let name = name.into();
        match name.to_str() {
            Some(url) if is_database(url) => Self::Database(url.to_owned()),
            _ => Self::Folder(name),
        }
    }

    /// The folder, if it is one.
    pub fn folder(&self) -> Option<&Path> {
        match self {
            Self::Folder(folder) => Some(folder),
            Self::Database(_) => None,
        }
    }
}

impl From<&Path> for StoreName {
    fn from(name: &Path) -> Self {
        Self::new(name)
    }
}

impl From<&PathBuf> for StoreName {
    fn from(name: &PathBuf) -> Self {
        Self::new(name)
    }
}

impl From<&Self> for StoreName {
    fn from(name: &Self) -> Self {
        name.clone()
    }
}

impl fmt::Display for StoreName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => folder.display().fmt(f),
            Self::Database(url) => f.write_str(&without_secrets(url)),
        }
    }
}

impl fmt::Debug for StoreName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_url_is_a_database_and_its_password_is_never_shown() {
        let url = StoreName::new("postgres://me:secret@host/farm?password=secret");
        assert!(matches!(url, StoreName::Database(_)));
        assert_eq!(url.to_string(), "postgres://me@host:5432/farm");
        assert_eq!(format!("{url:?}"), "postgres://me@host:5432/farm");
        let folder = StoreName::new("a/postgres:/store");
        assert_eq!(folder.folder(), Some(Path::new("a/postgres:/store")));
    }
}
