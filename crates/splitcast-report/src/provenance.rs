//! Where results come from: machine, program, compiler, time.

use std::env;
use std::ffi::OsString;
use std::path::Path;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use sysinfo::{CpuRefreshKind, MemoryRefreshKind, RefreshKind, System};

/// What stands for everything that cannot be found out.
const UNKNOWN: &str = "unknown";

/// What it takes to place a measurement. What is not known says "unknown".
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Model of the processor.
    pub cpu: String,
    /// Hardware threads that this process may use; `None` if unknown.
    pub logical_processors: Option<usize>,
    /// Size of the main memory in bytes; `None` if unknown.
    pub memory_bytes: Option<u64>,
    /// Name and version of the operating system.
    pub operating_system: String,
    /// The instruction set family that the program is built for, such as `x86_64`.
    pub architecture: String,
    /// Name and version of the program.
    pub program: String,
    /// The commit that it was built from, with ` + changes` if sources differed from it.
    pub commit: String,
    /// Name and version of the compiler.
    pub compiler: String,
    /// Date and time in ISO 8601, UTC, to the second.
    pub time: String,
    /// The command line, quoted for a POSIX shell.
    pub command: String,
}

impl Provenance {
    /// Looks around on this machine, now. Name and version are those of the program
    /// that asks: `Provenance::collect("splitcast", env!("CARGO_PKG_VERSION"))`.
    pub fn collect(program: &str, version: &str) -> Self {
        let wanted = RefreshKind::nothing()
            .with_cpu(CpuRefreshKind::nothing())
            .with_memory(MemoryRefreshKind::nothing().with_ram());
        let system = System::new_with_specifics(wanted);
        let cpu = system
            .cpus()
            .first()
            .map(|cpu| cpu.brand().trim().to_owned());
        // Of the program its name, not the folder it lay in.
        let name = |path: OsString| {
            Path::new(&path)
                .file_name()
                .map_or(path.clone(), OsString::from)
        };
        let arguments = (env::args_os().take(1).map(name))
            .chain(env::args_os().skip(1))
            .map(|argument| quoted(&argument.to_string_lossy()));
        Self {
            cpu: known(cpu),
            logical_processors: std::thread::available_parallelism().ok().map(usize::from),
            memory_bytes: Some(system.total_memory()).filter(|&bytes| bytes > 0),
            operating_system: known(System::long_os_version()),
            architecture: env::consts::ARCH.into(),
            program: format!("{program} {version}"),
            commit: env!("SPLITCAST_COMMIT").into(),
            compiler: env!("SPLITCAST_COMPILER").into(),
            time: Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string(),
            command: arguments.collect::<Vec<_>>().join(" "),
        }
    }

    /// Terms and what they stand for, for [`Section::definitions`](crate::Section::definitions).
    pub fn definitions(&self) -> Vec<(&'static str, String)> {
        let processors = self.logical_processors.map(|count| count.to_string());
        let gibibytes = |bytes: u64| format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30));
        vec![
            ("Processor", self.cpu.clone()),
            ("Logical processors", known(processors)),
            ("Memory", known(self.memory_bytes.map(gibibytes))),
            ("Operating system", self.operating_system.clone()),
            ("Architecture", self.architecture.clone()),
            ("Program", self.program.clone()),
            ("Commit", self.commit.clone()),
            ("Compiler", self.compiler.clone()),
            ("Time (UTC)", self.time.clone()),
            ("Command", self.command.clone()),
        ]
    }
}

fn known(value: Option<String>) -> String {
    value
        .filter(|text| !text.is_empty())
        .unwrap_or_else(|| UNKNOWN.into())
}

/// An argument as a POSIX shell would take it back.
fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,@%+".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        argument.into()
    } else {
        format!("'{}'", argument.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_known_or_said_to_be_unknown() {
        let provenance = Provenance::collect("splitcast", "1.2.3");
        assert_eq!(provenance.program, "splitcast 1.2.3");
        assert!(
            provenance
                .definitions()
                .iter()
                .all(|(_, value)| !value.is_empty())
        );
        assert!(provenance.time.parse::<Timestamp>().is_ok());
        assert_eq!(provenance.time.len(), "2026-01-31T00:00:00Z".len());
        let hash = provenance.commit.split(' ').next().unwrap_or_default();
        let is_hash = hash.len() >= 40 && hash.bytes().all(|c| c.is_ascii_hexdigit());
        assert!(
            is_hash || provenance.commit == UNKNOWN,
            "{}",
            provenance.commit
        );
        assert!(provenance.compiler.starts_with("rustc ") || provenance.compiler == UNKNOWN);
    }

    #[test]
    fn provenance_survives_json() {
        let provenance = Provenance::collect("splitcast", "1.2.3");
        let json = serde_json::to_string(&provenance).unwrap();
        assert_eq!(
            serde_json::from_str::<Provenance>(&json).unwrap(),
            provenance
        );
    }

    #[test]
    fn commands_are_quoted_for_a_shell() {
        assert_eq!(quoted("--frames=0..48"), "--frames=0..48");
        assert_eq!(quoted("my scene"), "'my scene'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
