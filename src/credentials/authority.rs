//! Who signs certificates: a key that stays with whoever made the folder.

use super::files::{make_folder, read, replace, write};
use anyhow::Context;
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DnType, ExtendedKeyUsagePurpose, IsCa,
    KeyPair, KeyUsagePurpose,
};
use std::path::Path;
use std::time::{Duration, SystemTime};

/// How far back certificates are valid, for machines whose clocks differ.
const CLOCK_SKEW: Duration = Duration::from_secs(3600);

/// An authority, and how long what it signs is valid.
pub struct Authority {
    issuer: CertifiedIssuer<'static, KeyPair>,
    days: u64,
}

impl Authority {
    /// A new one, whose key lives as long as this process unless it is kept.
    pub fn new(days: u64) -> anyhow::Result<Self> {
        Self::with_key(KeyPair::generate()?, days)
    }

    /// The one whose key an earlier call kept in `folder`. Its certificate is made anew: it has the name
    /// and the key of the one before, so whoever believes that one believes this one.
    pub fn kept(folder: &Path, days: u64) -> anyhow::Result<Self> {
        Self::with_key(read_key(folder)?, days)
    }

    fn with_key(key: KeyPair, days: u64) -> anyhow::Result<Self> {
        let mut parameters = valid_for(CertificateParams::new(Vec::new())?, days);
        let name = &mut parameters.distinguished_name;
        name.push(DnType::CommonName, "brdfarm development authority");
        parameters.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        parameters.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        Ok(Self {
            issuer: CertifiedIssuer::self_signed(parameters, key)?,
            days,
        })
    }

    /// Keeps the key in `folder`, which is made.
    pub fn keep(&self, folder: &Path) -> anyhow::Result<()> {
        make_folder(folder)?;
        write(&folder.join("key.pem"), &self.issuer.key().serialize_pem())
    }

    /// Its certificate.
    pub fn pem(&self) -> String {
        self.issuer.pem()
    }

    /// Makes a key and a certificate for a coordinator under these hosts.
    pub fn sign_coordinator(&self, hosts: Vec<String>, folder: &Path) -> anyhow::Result<()> {
        self.sign_new(folder, |key| self.coordinator(hosts, key))
    }

    /// Makes a key and a certificate for a client of this role.
    pub fn sign_client(&self, role: &str, folder: &Path) -> anyhow::Result<()> {
        self.sign_new(folder, |key| self.client(role, key))
    }

    /// Signs the key that a coordinator has again, under these hosts.
    pub fn renew_coordinator(&self, hosts: Vec<String>, folder: &Path) -> anyhow::Result<()> {
        renew(folder, |key| self.coordinator(hosts, key))
    }

    /// Signs the key that a client has again.
    pub fn renew_client(&self, role: &str, folder: &Path) -> anyhow::Result<()> {
        renew(folder, |key| self.client(role, key))
    }

    fn sign_new(
        &self,
        folder: &Path,
        sign: impl FnOnce(&KeyPair) -> anyhow::Result<String>,
    ) -> anyhow::Result<()> {
        let key = KeyPair::generate()?;
        write(&folder.join("certificate.pem"), &sign(&key)?)?;
        write(&folder.join("key.pem"), &key.serialize_pem())
    }

    fn coordinator(&self, hosts: Vec<String>, key: &KeyPair) -> anyhow::Result<String> {
        let usage = ExtendedKeyUsagePurpose::ServerAuth;
        self.certificate("brdfarm coordinator", hosts, usage, key)
    }

    fn client(&self, role: &str, key: &KeyPair) -> anyhow::Result<String> {
        let usage = ExtendedKeyUsagePurpose::ClientAuth;
        self.certificate(&format!("brdfarm {role}"), Vec::new(), usage, key)
    }

    fn certificate(
        &self,
        name: &str,
        hosts: Vec<String>,
        usage: ExtendedKeyUsagePurpose,
        key: &KeyPair,
    ) -> anyhow::Result<String> {
        let parameters = CertificateParams::new(hosts)?;
        let mut parameters = valid_for(parameters, self.days);
        parameters.distinguished_name.push(DnType::CommonName, name);
        parameters.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        parameters.extended_key_usages = vec![usage];
        parameters.use_authority_key_identifier_extension = true;
        Ok(parameters.signed_by(key, &self.issuer)?.pem())
    }
}

fn renew(
    folder: &Path,
    sign: impl FnOnce(&KeyPair) -> anyhow::Result<String>,
) -> anyhow::Result<()> {
    let key = read_key(folder)?;
    replace(&folder.join("certificate.pem"), &sign(&key)?)
}

fn read_key(folder: &Path) -> anyhow::Result<KeyPair> {
    let path = folder.join("key.pem");
    let unreadable = || format!("{} is no key", path.display());
    KeyPair::from_pem(&read(&path)?).with_context(unreadable)
}

fn valid_for(mut parameters: CertificateParams, days: u64) -> CertificateParams {
    let now = SystemTime::now();
    parameters.not_before = (now - CLOCK_SKEW).into();
    parameters.not_after = (now + Duration::from_secs(days * 86_400)).into();
    parameters
}
