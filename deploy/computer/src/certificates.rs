//! Private certificate authority, and certificates of vessels, drones and operators.
//!
//! One authority signs all certificates. Each certificate carries the name of its side, which the radio's
//! rules check. Keys are ECDSA P-256 with SHA-256.

use std::{
    fs::{self, OpenOptions},
    io::Write,
    os::unix::fs::OpenOptionsExt,
    path::{Path, PathBuf},
};

use alight_shared::msg::Certificate;
use alight_transport::radio::TlsConfig;
use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer,
    KeyPair, KeyUsagePurpose, PublicKeyData,
};
use time::{Duration, OffsetDateTime};
use x509_parser::{extensions::ParsedExtension, pem::parse_x509_pem};

use crate::exit::{CliError, Doing};

const AUTHORITY: &str = "Alight private authority";
pub const AUTHORITY_FILE: &str = "authority.pem";
pub const AUTHORITY_KEY: &str = "authority-key.pem";
pub const CERTIFICATE_FILE: &str = "certificate.pem";
pub const KEY_FILE: &str = "key.pem";
/// Remaining validity below which a warning is given, days.
pub const RENEWAL_DAYS: i64 = 30;
const MAX_ADDRESSES: usize = 16;

pub fn common_name(kind: &str, number: u32) -> String {
    format!("{kind}-{number}")
}

fn params(name: &str, days: u32) -> CertificateParams {
    let mut params = CertificateParams::default();
    let mut subject = DistinguishedName::new();
    subject.push(DnType::CommonName, name);
    params.distinguished_name = subject;
    // Computers without a battery-backed clock start in the past.
    let now = OffsetDateTime::now_utc();
    params.not_before = now - Duration::days(1);
    params.not_after = now + Duration::days(i64::from(days));
    params
}

/// Creates the authority in `dir`; never replaces an existing one.
pub fn init(dir: &Path, days: u32) -> Result<(), CliError> {
    let doing = format_args!("making an authority in {}", dir.display());
    fs::create_dir_all(dir).doing(doing)?;
    let mut params = params(AUTHORITY, days);
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let key = KeyPair::generate().doing(doing)?;
    let certificate = params.self_signed(&key).doing(doing)?;
    write(&dir.join(AUTHORITY_KEY), &key.serialize_pem())?;
    write(&dir.join(AUTHORITY_FILE), &certificate.pem())
}

/// Creates the key and certificate of one side, signed by the authority in `dir`; returns their directory.
pub fn issue(
    dir: &Path,
    kind: &str,
    number: u32,
    addresses: &[String],
    days: u32,
) -> Result<PathBuf, CliError> {
    let name = common_name(kind, number);
    let doing = format_args!("making the certificate of {name}");
    if addresses.len() > MAX_ADDRESSES {
        return Err(CliError(format!(
            "{} addresses for {name}: a certificate names at most {MAX_ADDRESSES}",
            addresses.len()
        )));
    }
    let authority = read(
        &dir.join(AUTHORITY_FILE),
        "make an authority first: alight keys init",
    )?;
    let key = read(&dir.join(AUTHORITY_KEY), "it is needed to sign")?;
    let key = KeyPair::from_pem(&key).doing(doing)?;
    let until = expiry(&authority, &dir.join(AUTHORITY_FILE))?;
    let mut params = params(&name, days);
    if params.not_after > until {
        params.not_after = until;
    }
    let own: Vec<String> = if addresses.is_empty() {
        vec!["127.0.0.1".into(), "localhost".into()]
    } else {
        addresses.to_vec()
    };
    params.subject_alt_names = CertificateParams::new(own).doing(doing)?.subject_alt_names;
    // Either side may listen, so both act as server and client.
    params.extended_key_usages = vec![
        ExtendedKeyUsagePurpose::ServerAuth,
        ExtendedKeyUsagePurpose::ClientAuth,
    ];
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.use_authority_key_identifier_extension = true;
    // The signature needs only the authority's name and key.
    let signer = self::params(AUTHORITY, 1);
    let issuer = Issuer::from_params(&signer, &key);
    let own_key = KeyPair::generate().doing(doing)?;
    let certificate = params.signed_by(&own_key, &issuer).doing(doing)?;
    let directory = dir.join(&name);
    fs::create_dir_all(&directory).doing(doing)?;
    write(&directory.join(KEY_FILE), &own_key.serialize_pem())?;
    write(&directory.join(CERTIFICATE_FILE), &certificate.pem())?;
    write(&directory.join(AUTHORITY_FILE), &authority)?;
    Ok(directory)
}

/// TLS configuration from the files of one side; admits only `peers`.
pub fn files(directory: &Path, peers: Vec<String>) -> Result<TlsConfig, CliError> {
    let file = |name: &str| {
        let path = directory.join(name);
        match path.canonicalize() {
            Ok(whole) => Ok(whole.display().to_string()),
            Err(e) => Err(CliError::because(
                format!("looking for {} (alight keys makes it)", path.display()),
                e,
            )),
        }
    };
    Ok(TlsConfig {
        authority: file(AUTHORITY_FILE)?,
        certificate: file(CERTIFICATE_FILE)?,
        key: file(KEY_FILE)?,
        peers,
        ..TlsConfig::default()
    })
}

/// Writes a new file that only its owner can read.
fn write(path: &Path, text: &str) -> Result<(), CliError> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true).mode(0o600);
    let written = options.open(path).and_then(|mut file| {
        let written = file.write_all(text.as_bytes()).and_then(|()| file.sync_all());
        if written.is_err() {
            // A key of 0 bytes on a full disk would be taken for an existing one.
            let _gone = fs::remove_file(path);
        }
        written
    });
    written.doing(format_args!(
        "writing {} (an existing file is never replaced: use it, or move it away to make a new one)",
        path.display()
    ))
}

/// Contents of a text file; `hint` is appended to the error.
pub fn read(path: &Path, hint: &str) -> Result<String, CliError> {
    fs::read_to_string(path).doing(format_args!("reading {} ({hint})", path.display()))
}

pub struct CertificateDetails {
    pub certificate: Certificate,
    /// SubjectPublicKeyInfo, DER.
    public_key: Vec<u8>,
    /// Subject key identifier, in the certificate of an authority.
    key_id: Option<Vec<u8>>,
    signed_with: Option<Vec<u8>>,
}

pub fn read_certificate(path: &Path) -> Result<CertificateDetails, CliError> {
    let pem = read(path, "alight keys makes it")?;
    let doing = format_args!("{} is not a certificate", path.display());
    let (_rest, found) = parse_x509_pem(pem.as_bytes()).doing(doing)?;
    let certificate = found.parse_x509().doing(doing)?;
    let mut key_id = None;
    let mut signed_with = None;
    for extension in certificate.extensions() {
        match extension.parsed_extension() {
            ParsedExtension::SubjectKeyIdentifier(id) => key_id = Some(id.0.to_vec()),
            ParsedExtension::AuthorityKeyIdentifier(id) => {
                signed_with = id.key_identifier.as_ref().map(|id| id.0.to_vec());
            }
            _ => {}
        }
    }
    let now = OffsetDateTime::now_utc();
    let validity = certificate.validity();
    let name = certificate.subject().iter_common_name().next();
    Ok(CertificateDetails {
        certificate: Certificate {
            path: path.display().to_string().as_str().into(),
            days_left: (validity.not_after.to_datetime() - now)
                .whole_seconds()
                .div_euclid(86_400),
            in_future: validity.not_before.to_datetime() > now,
            name: name.and_then(|n| n.as_str().ok()).unwrap_or("unnamed").into(),
        },
        public_key: certificate.public_key().raw.to_vec(),
        key_id,
        signed_with,
    })
}

pub fn key_matches(pem: &str, own: &CertificateDetails) -> bool {
    KeyPair::from_pem(pem).is_ok_and(|key| key.subject_public_key_info() == own.public_key)
}

/// Whether the key of `authority` signed `own`, by their key identifiers; None if either has none.
pub fn is_signed_by(own: &CertificateDetails, authority: &CertificateDetails) -> Option<bool> {
    Some(own.signed_with.as_ref()? == authority.key_id.as_ref()?)
}

pub fn today_s() -> i64 {
    OffsetDateTime::now_utc().unix_timestamp()
}

pub fn expiry(pem: &str, path: &Path) -> Result<OffsetDateTime, CliError> {
    let (_rest, found) =
        parse_x509_pem(pem.as_bytes()).doing(format_args!("{} is not a certificate", path.display()))?;
    let certificate = found
        .parse_x509()
        .doing(format_args!("{} is not a certificate", path.display()))?;
    Ok(certificate.validity().not_after.to_datetime())
}
