//! Devices: one for each instruction set, made at first use and kept.

use std::ffi::CStr;
use std::fmt::{Display, Formatter, Result as FormatResult};
use std::ptr;
use std::str::FromStr;
use std::sync::OnceLock;

use super::abi;
use super::error::EmbreeError;
use super::library::{self, Functions};

/// An instruction set of x86-64 that Embree has code for, in widening order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Isa {
    /// SSE2, which every x86-64 processor has.
    Sse2,
    /// SSE4.2.
    Sse42,
    /// AVX.
    Avx,
    /// AVX2.
    Avx2,
    /// AVX-512.
    Avx512,
}

impl Isa {
    /// Every one, in widening order.
    pub const ALL: [Self; 5] = [Self::Sse2, Self::Sse42, Self::Avx, Self::Avx2, Self::Avx512];

    /// Embree takes a name it does not know for SSE2 without a word: these are the names that its
    /// configuration parser knows.
    fn configuration(self) -> &'static CStr {
        match self {
            Self::Sse2 => c"threads=1,isa=sse2",
            Self::Sse42 => c"threads=1,isa=sse4.2",
            Self::Avx => c"threads=1,isa=avx",
            Self::Avx2 => c"threads=1,isa=avx2",
            Self::Avx512 => c"threads=1,isa=avx512",
        }
    }

    /// The widest packet of rays that code for this set traces natively.
    fn packet_width(self) -> u32 {
        match self {
            Self::Sse2 | Self::Sse42 => 4,
            Self::Avx | Self::Avx2 => 8,
            Self::Avx512 => 16,
        }
    }
}

/// A name that is no instruction set's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no instruction set is called {0:?}: write sse2, sse4.2, avx, avx2 or avx512")]
pub struct UnknownIsa(String);

impl FromStr for Isa {
    type Err = UnknownIsa;

    fn from_str(name: &str) -> Result<Self, UnknownIsa> {
        Self::ALL
            .into_iter()
            .find(|isa| isa.to_string() == name)
            .ok_or_else(|| UnknownIsa(name.to_owned()))
    }
}

impl Display for Isa {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> FormatResult {
        formatter.write_str(match self {
            Self::Sse2 => "sse2",
            Self::Sse42 => "sse4.2",
            Self::Avx => "avx",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        })
    }
}

/// A device of Embree's. It is never released: it serves until the process ends.
pub struct Device {
    pub functions: &'static Functions,
    pub handle: *mut abi::Device,
}

// SAFETY: Embree allows calls with one device from several threads at once, and the handle is
// never released.
unsafe impl Send for Device {}
// SAFETY: as above.
unsafe impl Sync for Device {}

/// The device for an instruction set, or for the widest that the machine has.
pub fn device(isa: Option<Isa>) -> Result<&'static Device, EmbreeError> {
    type Slot = OnceLock<Result<Device, EmbreeError>>;
    static WIDEST: Slot = Slot::new();
    static FORCED: [Slot; Isa::ALL.len()] = [const { Slot::new() }; Isa::ALL.len()];
    let slot = isa.map_or(&WIDEST, |isa| &FORCED[isa as usize]);
    slot.get_or_init(|| open(isa))
        .as_ref()
        .map_err(EmbreeError::clone)
}

fn open(isa: Option<Isa>) -> Result<Device, EmbreeError> {
    let functions = library::functions()?;
    let configuration = isa.map_or(library::CONFIGURATION, Isa::configuration);
    let refused = |reason| EmbreeError::Device {
        wanted: isa.map_or_else(|| "at all".to_owned(), |isa| format!("with {isa}")),
        reason,
    };
    // SAFETY: a NUL-terminated configuration, read during the call alone.
    let handle = unsafe { (functions.new_device)(configuration.as_ptr()) };
    if handle.is_null() {
        // SAFETY: without a device the function gives this thread's error.
        let code = unsafe { (functions.device_error)(ptr::null_mut()) };
        return Err(refused(abi::error_text(code)));
    }
    let device = Device { functions, handle };
    if isa.is_some_and(|isa| isa.packet_width() != device.packet_width()) {
        // SAFETY: nobody else has the handle yet.
        unsafe { (functions.release_device)(handle) };
        return Err(refused("the library is built without it"));
    }
    Ok(device)
}

impl Device {
    /// The widest packet of rays that the device traces natively: all that Embree lets be read
    /// back of the instruction set in use.
    fn packet_width(&self) -> u32 {
        // SAFETY: the handle is alive.
        let has =
            |property| unsafe { (self.functions.device_property)(self.handle, property) != 0 };
        if has(abi::DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) {
            16
        } else if has(abi::DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) {
            8
        } else {
            4
        }
    }

    /// What went wrong in `call`, if anything has on this thread since the last time of asking.
    pub fn outcome(&self, call: &'static str) -> Result<(), EmbreeError> {
        // SAFETY: the handle is alive.
        match unsafe { (self.functions.device_error)(self.handle) } {
            abi::ERROR_NONE => Ok(()),
            code => Err(EmbreeError::Build {
                call,
                reason: abi::error_text(code),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back_and_are_embrees() {
        for isa in Isa::ALL {
            assert_eq!(isa.to_string().parse(), Ok(isa));
            let configuration = isa.configuration().to_str().unwrap();
            assert_eq!(configuration, format!("threads=1,isa={isa}"));
        }
        assert!("sse42".parse::<Isa>().is_err());
    }

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn instruction_set_that_the_processor_lacks_is_refused() {
        let answer = device(Some(Isa::Avx512));
        if is_x86_feature_detected!("avx512f") {
            assert_eq!(answer.map(Device::packet_width), Ok(16));
        } else {
            let sentence = answer.map(Device::packet_width).unwrap_err().to_string();
            assert_eq!(
                sentence,
                "Embree cannot run with avx512 on this machine: the processor lacks the \
                 instruction set"
            );
        }
        assert_eq!(device(Some(Isa::Sse2)).map(Device::packet_width), Ok(4));
    }
}
