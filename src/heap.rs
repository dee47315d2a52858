//! How many arenas the heap has, and when the system gets back what is free in them.

/// Lets the heap have as many arenas as the machine has cores.
///
/// The GNU C library gives each thread an arena of its own, up to eight for each core. What one thread
/// frees, threads of other arenas cannot use, so each arena keeps the most that it ever had. Measured on
/// two cores: 300 materials take 47 MB instead of 54, in the same time. A limit in the environment takes
/// precedence.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn limit_arenas() {
    let tunables = std::env::var("GLIBC_TUNABLES").unwrap_or_default();
    let is_set = tunables.contains("glibc.malloc.arena_max");
    if !is_set && std::env::var_os("MALLOC_ARENA_MAX").is_none() {
        set_arena_max(i32::try_from(crate::cores::count(0)).unwrap_or(i32::MAX));
    }
}

/// Other C libraries have no such arenas.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn limit_arenas() {}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code, reason = "a parameter of the C library")]
fn set_arena_max(arenas: i32) {
    // SAFETY: mallopt takes two numbers by value and locks what it changes. Where it refuses, arenas are as
    // many as they were.
    unsafe { libc::mallopt(libc::M_ARENA_MAX, arenas) };
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
