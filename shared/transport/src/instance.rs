//! Instance: set of processes on one computer, with the names of its services.

use std::{fs, path::PathBuf};

use iceoryx2::prelude::*;

use crate::{TransportContext, TransportError};

/// iceoryx2 service type: inter-process, each port used by one thread.
pub(super) type Ipc = ipc::Service;

/// Directory of installed services (RuntimeDirectory and TMPDIR of their units).
const SERVICE: &str = "/run/alight";

/// Maximum length of a socket path, bytes (`sun_path` of unix(7)).
const MAX_SOCKET_PATH: usize = 108;
/// Length of an iceoryx2 socket name: a slash, 32 digits and `.event`.
const SOCKET_NAME: usize = 1 + 32 + 6;

pub(super) fn service_name(name: &str) -> Result<ServiceName, TransportError> {
    ServiceName::new(name).doing(|| format!("naming the service {name}"))
}

/// Set of processes on one computer; several may run in parallel under different names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    name: String,
}

impl Instance {
    /// Instance `name`: 1 to 32 characters of a-z, 0-9 and '-'.
    pub fn new(name: &str) -> Result<Instance, TransportError> {
        let fits = (1..=32).contains(&name.len())
            && name
                .bytes()
                .all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-');
        if fits {
            Ok(Instance { name: name.into() })
        } else {
            let what = "a name is 1 to 32 of a-z, 0-9 and '-'".into();
            let doing = format!("naming the instance {name:?}");
            Err(TransportError { doing, what })
        }
    }
    pub fn name(&self) -> &str {
        &self.name
    }
    /// Directory of the instance's other files: that of the installed service if the instance has its name, so that
    /// an operator's commands find it; otherwise a temporary directory.
    pub fn directory(&self) -> PathBuf {
        let name = format!("alight-{}", self.name);
        let of_service = std::path::Path::new(SERVICE).join(&name);
        if of_service.exists() {
            of_service
        } else {
            std::env::temp_dir().join(name)
        }
    }
    pub fn prefix(&self) -> String {
        format!("alight_{}_", self.name)
    }
    /// Removes the instance's files from shared memory and the middleware. None of its processes may be running.
    pub fn wipe(&self) -> std::io::Result<()> {
        let prefix = self.prefix();
        for directory in ["/dev/shm", "/tmp"] {
            let Ok(entries) = fs::read_dir(directory) else {
                continue;
            };
            for entry in entries.flatten() {
                if entry.file_name().to_string_lossy().starts_with(&prefix) {
                    let _gone = fs::remove_file(entry.path());
                }
            }
        }
        match fs::remove_dir_all(self.middleware()) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(e),
            Ok(()) | Err(_) => Ok(()),
        }
    }
    pub(super) fn middleware(&self) -> PathBuf {
        self.directory().join("iceoryx2")
    }
    pub(super) fn config(&self) -> Result<Config, TransportError> {
        let doing = || format!("naming the files of instance {}", self.name);
        let path = self.middleware().as_os_str().len() + self.prefix().len() + SOCKET_NAME;
        if path > MAX_SOCKET_PATH {
            let spare = path - MAX_SOCKET_PATH;
            let what = format!(
                "in {} the paths of its sockets are longer than {MAX_SOCKET_PATH} bytes: a name that is {spare} shorter \
                 fits",
                self.middleware().display()
            );
            return Err(TransportError { doing: doing(), what });
        }
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.prefix().as_bytes()).doing(doing)?;
        let root = format!("{}/", self.middleware().display());
        config
            .global
            .set_root_path(&Path::new(root.as_bytes()).doing(doing)?);
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instance_with_too_long_socket_paths() {
        let instance = |bytes: usize| Instance::new(&"a".repeat(bytes)).map(|i| i.config());
        assert!(matches!(instance(2), Ok(Ok(_))));
        let Ok(Err(rejected)) = instance(32) else {
            panic!("a name of 32 bytes leaves no room for a socket path");
        };
        assert!(rejected.to_string().contains("shorter fits"), "{rejected}");
        assert!(instance(33).is_err());
    }
}
