//! How many arenas the heap has, what is kept out of them, and when the system gets back what is free.

/// Pieces of so many bytes have memory of their own, which the system has back as soon as they are freed. Chosen: more
/// than the film of an image of 128 x 128 pixels (393 kB), which is asked for again and again, and no more than each of
/// the 41 histograms of sled (524 kB), which nobody writes to: alone, they take no memory.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGE_BYTES: i32 = 512 << 10;

/// So much may be free at an arena's end before the system has it back. Measured: with half of it the system has to find
/// twice as many pages, with twice a third as many; but then 1,000 materials take up to 60 MB again.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const FREE_BYTES: i32 = 1 << 20;

/// Lets the heap have as many arenas as the machine has cores, and keeps large pieces out of them.
///
/// The GNU C library gives each thread an arena of its own, up to eight for each core. What one thread
/// frees, threads of other arenas cannot use, so each arena keeps the most that it ever had. Measured on
/// two cores: 300 materials take 47 MB instead of 54, in the same time.
///
/// Once a large piece was freed, the library takes pieces up to its size from arenas, and keeps twice as much
/// at their ends. Of the preset's first 1,000 materials two take ten megabytes more than all others, in three
/// pieces. Measured: with this limit 1,000 materials take 57 MB, and without it 60, in the same time.
///
/// Limits in the environment take precedence.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn configure() {
    let arenas = i32::try_from(crate::cores::count(0)).unwrap_or(i32::MAX);
    for (parameter, tunable, variable, value) in [
        (libc::M_ARENA_MAX, "arena_max", "MALLOC_ARENA_MAX", arenas),
        (
            libc::M_MMAP_THRESHOLD,
            "mmap_threshold",
            "MALLOC_MMAP_THRESHOLD_",
            LARGE_BYTES,
        ),
        (
            libc::M_TRIM_THRESHOLD,
            "trim_threshold",
            "MALLOC_TRIM_THRESHOLD_",
            FREE_BYTES,
        ),
    ] {
        let tunables = std::env::var("GLIBC_TUNABLES").unwrap_or_default();
        let is_set = tunables.contains(&format!("glibc.malloc.{tunable}"));
        if !is_set && std::env::var_os(variable).is_none() {
            set(parameter, value);
        }
    }
}

/// Other C libraries have no such parameters.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn configure() {}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code, reason = "a parameter of the C library")]
fn set(parameter: i32, value: i32) {
    // SAFETY: mallopt takes two numbers by value and locks what it changes. Where it refuses, the parameter is as it
    // was.
    unsafe { libc::mallopt(parameter, value) };
}

/// Gives back to the system what is free in the heap.
///
/// The GNU C library keeps what is free below the last piece in use, in every arena. After rendering that is
/// more than all that is in use, and what comes next would need its own on top.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code, reason = "a function of the C library")]
pub fn give_back() {
    // SAFETY: malloc_trim takes a number by value and locks each arena while it looks for free pages.
    unsafe { libc::malloc_trim(0) };
}

/// For other C libraries we know no such call.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn give_back() {}

#[cfg(all(test, target_os = "linux", target_env = "gnu"))]
mod tests {
    use super::*;

    /// What this process has in memory, bytes.
    fn resident() -> usize {
        let statm = std::fs::read_to_string("/proc/self/statm").expect("Linux tells");
        let pages = statm.split(' ').nth(1).expect("the second is resident");
        4096 * pages.parse::<usize>().expect("a number")
    }

    #[test]
    fn free_memory_below_a_piece_in_use_is_given_back() {
        const PIECE: usize = 3000;
        let mut pieces: Vec<Vec<u8>> = (0..(64 << 20) / PIECE).map(|_| vec![1; PIECE]).collect();
        let full = resident();
        pieces.reverse();
        pieces.truncate(1);
        let freed = resident();
        give_back();
        let given_back = resident();
        // Other tests of this process may hold a few megabytes more or less by now.
        assert!(freed + (16 << 20) > full, "{full} to {freed} on its own");
        assert!(given_back + (48 << 20) < freed, "{freed} to {given_back}");
    }
}
