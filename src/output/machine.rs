//! The machine that figures were measured on, as far as it says: enough to judge whether two timings may be compared.

/// A machine.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Machine {
    /// Model of the processor; `unknown` where the system does not say.
    pub cpu: String,
    /// Logical cores that this process may use.
    pub cores: usize,
    /// Threads that the work ran in.
    pub threads: usize,
    /// Operating system and architecture.
    pub os: String,
}

impl Machine {
    /// This one, its work running in the current thread pool.
    pub fn this() -> Self {
        let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        Self {
            cpu: cpu_model(&cpuinfo).unwrap_or("unknown").to_owned(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            threads: rayon::current_num_threads(),
            os: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        }
    }
}

/// The first model name in the text of Linux's `/proc/cpuinfo`.
fn cpu_model(cpuinfo: &str) -> Option<&str> {
    let (_, model) = cpuinfo.lines().find(|line| line.starts_with("model name"))?.split_once(':')?;
    Some(model.trim()).filter(|model| !model.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processor_is_named_as_linux_names_it() {
        let text = "processor\t: 0\nmodel\t\t: 17\nmodel name\t: Fast CPU @ 3 GHz\nflags\t: a b\n";
        assert_eq!(cpu_model(text), Some("Fast CPU @ 3 GHz"));
        assert_eq!(cpu_model("Processor : ARM\n"), None);
    }

    #[test]
    fn a_machine_counts_the_threads_of_the_pool_that_it_is_asked_in() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(pool.install(Machine::this).threads, 3);
    }
}
