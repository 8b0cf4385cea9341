//! What makes a machine a rig: rules of udev, unit, installer, settings, and what systemd is told. Without a camera, without
//! systemd, and without touching this machine; what needs a tool that is absent is skipped by name.

mod installing;
mod machine;
mod rules;
mod service;
mod settings;
#[path = "../record/source.rs"]
mod source;
mod unit;
