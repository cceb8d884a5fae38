//! How much memory a run may use: what the machine has, what its control group allows, and sizes in words.

use crate::error::Error;

/// Memory that is assumed where the system does not say how much it has.
const ASSUMED_BYTES: u64 = 8 << 30;

/// Bytes of memory that this process may use: the least of what the machine has, what its control group and those above it allow, and what
/// the process itself may have (`ulimit -v`).
///
/// The memory of the whole machine counts, not what is free now: that changes while a run lasts, and with it would what is decided from it.
pub fn memory_limit_bytes() -> u64 {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let machine = read("/proc/meminfo").and_then(|text| total_bytes(&text));
    let groups = read("/proc/self/cgroup").unwrap_or_default();
    let allowed = limit_files(&groups).iter().filter_map(|path| group_bytes(&read(path)?)).min();
    machine.into_iter().chain(allowed).chain(process_bytes()).min().unwrap_or(ASSUMED_BYTES)
}

/// The address space and the data that the process may have, where either is limited.
#[cfg(unix)]
fn process_bytes() -> Option<u64> {
    use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
    let limits = [Resource::RLIMIT_AS, Resource::RLIMIT_DATA].map(|resource| getrlimit(resource).ok());
    limits.into_iter().flatten().map(|(soft, _)| soft).filter(|&soft| soft != RLIM_INFINITY).min()
}

#[cfg(not(unix))]
fn process_bytes() -> Option<u64> {
    None
}

/// The memory of the machine in the text of `/proc/meminfo`.
fn total_bytes(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// The limit in the text of `memory.max` or `memory.limit_in_bytes`; `None` if there is none.
fn group_bytes(text: &str) -> Option<u64> {
    text.trim().parse().ok().filter(|&bytes| bytes > 0)
}

/// The files with the memory limits of the groups that `/proc/self/cgroup` lists, and of all groups above them, version 2 and version 1.
/// In a container the path may be that of the host: there the root of the hierarchy has the limit, which the list ends with.
fn limit_files(groups: &str) -> Vec<String> {
    let of_line = |line: &str| {
        let mut fields = line.splitn(3, ':');
        let (_, controllers, path) = (fields.next()?, fields.next()?, fields.next()?);
        let (root, file) = match controllers {
            "" => ("/sys/fs/cgroup", "memory.max"),
            _ if controllers.split(',').any(|name| name == "memory") => {
                ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")
            }
            _ => return None,
        };
        let own = path.trim_end_matches('/');
        let ends = own.char_indices().filter(|&(_, c)| c == '/').map(|(end, _)| end).chain([own.len()]);
        let mut folders: Vec<&str> = ends.map(|end| &own[..end]).collect();
        folders.dedup();
        Some(folders.into_iter().rev().map(|folder| format!("{root}{folder}/{file}")).collect::<Vec<_>>())
    };
    groups.lines().filter_map(of_line).flatten().collect()
}

/// The units of sizes, the larger ones first.
const UNITS: [(&str, u64); 9] = [
    ("tib", 1 << 40),
    ("gib", 1 << 30),
    ("mib", 1 << 20),
    ("kib", 1 << 10),
    ("tb", 1_000_000_000_000),
    ("gb", 1_000_000_000),
    ("mb", 1_000_000),
    ("kb", 1000),
    ("b", 1),
];

/// The bytes of a size such as `4GiB`, `1.5 GiB`, `800MB`, `4G` (`GiB`) or `4294967296`. Upper and lower case are the same.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for anything else, for 0, and for more bytes than 64 bits count.
pub fn parse_bytes(text: &str) -> Result<u64, Error> {
    let refused = || {
        Error::settings("this is not a size of memory")
            .with("found", format!("{text:?}"))
            .with("expected", "a number above 0 with a unit: 4GiB, 1.5GiB, 800MB, or bytes without one")
    };
    let lower = text.trim().to_lowercase();
    let digits = lower.find(|c: char| c != '.' && !c.is_ascii_digit()).unwrap_or(lower.len());
    let (number, unit) = lower.split_at(digits);
    let unit = match unit.trim() {
        "" => 1,
        // As `du` and `ls` write them.
        short @ ("k" | "m" | "g" | "t") => {
            UNITS.iter().find(|(name, _)| *name == format!("{short}ib")).map_or(1, |(_, bytes)| *bytes)
        }
        unit => UNITS.iter().find(|(name, _)| *name == unit).ok_or_else(refused)?.1,
    };
    let bytes = number.parse::<f64>().map_err(|_| refused())? * unit as f64;
    if bytes >= 1.0 && bytes < u64::MAX as f64 { Ok(bytes as u64) } else { Err(refused()) }
}

/// `bytes` in words, rounded up to a tenth of its unit: `4 GiB`, `43.2 GiB`, `800 MiB`.
pub fn shown_bytes(bytes: u64) -> String {
    let (unit, size) = match bytes {
        0..0x4000_0000 => ("MiB", 1 << 20),
        _ => ("GiB", 1_u64 << 30),
    };
    let tenths = (bytes as f64 * 10.0 / size as f64).ceil();
    let number = tenths / 10.0;
    format!("{number} {unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_and_all_groups_above_it_limit_the_memory() {
        let version_2 = limit_files("0::/system.slice/job.scope\n");
        assert_eq!(
            version_2,
            [
                "/sys/fs/cgroup/system.slice/job.scope/memory.max",
                "/sys/fs/cgroup/system.slice/memory.max",
                "/sys/fs/cgroup/memory.max"
            ]
        );
        let version_1 = limit_files("11:cpu,cpuacct:/a\n9:memory:/docker/b\n1:name=systemd:/c\n");
        assert_eq!(
            version_1,
            [
                "/sys/fs/cgroup/memory/docker/b/memory.limit_in_bytes",
                "/sys/fs/cgroup/memory/docker/memory.limit_in_bytes",
                "/sys/fs/cgroup/memory/memory.limit_in_bytes"
            ]
        );
        assert_eq!(limit_files("0::/\n"), ["/sys/fs/cgroup/memory.max"], "a container's own root");
        assert!(limit_files("nonsense").is_empty() && limit_files("").is_empty());
    }

    #[test]
    fn limits_are_bytes_or_none() {
        assert_eq!(
            [group_bytes("max\n"), group_bytes("1073741824\n"), group_bytes("")],
            [None, Some(1 << 30), None]
        );
        assert_eq!(total_bytes("MemTotal:       16384 kB\nMemFree: 1 kB\n"), Some(16 << 20));
        assert_eq!(total_bytes("MemFree: 1 kB\n"), None);
        assert!(memory_limit_bytes() > 0);
    }

    #[test]
    fn a_size_has_a_binary_or_a_decimal_unit_or_none() {
        let sizes = [
            ("4GiB", 4 << 30),
            ("4G", 4 << 30),
            ("1.5 gib", 3 << 29),
            ("800MB", 800_000_000),
            ("512k", 512 << 10),
            ("123", 123),
            ("2TB", 2_000_000_000_000),
        ];
        for (text, bytes) in sizes {
            assert_eq!(parse_bytes(text).unwrap(), bytes, "{text}");
        }
        for text in ["", "GiB", "4 bytes", "-4GiB", "1e9", "0", "0.1b", "99999999999TiB", "1.2.3G", "nan"] {
            let message = parse_bytes(text).unwrap_err().to_string();
            assert!(message.contains("4GiB, 1.5GiB, 800MB"), "{text}: {message}");
        }
    }

    #[test]
    fn a_size_in_words_is_rounded_up_so_that_it_is_enough() {
        let shown = [4 << 30, (4 << 30) + 1, 800 << 20, 1, 46_385_646_797].map(shown_bytes);
        assert_eq!(shown, ["4 GiB", "4.1 GiB", "800 MiB", "0.1 MiB", "43.3 GiB"]);
    }
}
