//! Test certificates.

use std::path::{Path, PathBuf};
use std::process::Command;

/// An authority and one certificate for both sides, made with the `openssl` program; None without it.
pub fn certificates(name: &str) -> Option<PathBuf> {
    let directory = std::env::temp_dir().join(format!("alight-certificates-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&directory).expect("a directory");
    std::fs::write(
        directory.join("names"),
        "subjectAltName=IP:127.0.0.1,IP:10.77.0.1,DNS:localhost\n",
    )
    .expect("written");
    let key = [
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:prime256v1",
        "-nodes",
    ];
    let made = run(
        &directory,
        &[
            &[
                "req",
                "-x509",
                "-keyout",
                "ca.pem",
                "-out",
                "authority.pem",
                "-days",
                "2",
                "-subj",
                "/CN=test",
            ],
            &key[..],
        ]
        .concat(),
    ) && run(
        &directory,
        &[
            &[
                "req",
                "-keyout",
                "key.pem",
                "-out",
                "request.pem",
                "-subj",
                "/CN=alight",
            ],
            &key[..],
        ]
        .concat(),
    ) && run(
        &directory,
        &[
            "x509",
            "-req",
            "-in",
            "request.pem",
            "-CA",
            "authority.pem",
            "-CAkey",
            "ca.pem",
            "-CAcreateserial",
            "-days",
            "2",
            "-extfile",
            "names",
            "-out",
            "certificate.pem",
        ],
    );
    if !made {
        eprintln!("skipped: no openssl program to make test certificates with");
    }
    made.then_some(directory)
}

fn run(directory: &Path, arguments: &[&str]) -> bool {
    Command::new("openssl")
        .args(arguments)
        .current_dir(directory)
        .output()
        .is_ok_and(|out| out.status.success())
}
