//! Gives the library the name under which programs look for libusb.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // Whoever needs this name is served by the library that has it already, so the real one is not loaded.
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libusb-1.0.so.0");
}
