//! `glintd list` and `glintd doctor`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use serde_json::json;

use crate::clock::HostClock;
use crate::doctor::{Finding, Identity, Roots, Severity, examine};

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  glintd doctor --folder /var/lib/glint")]
pub(super) struct DoctorArgs {
    /// Where recordings would go: its disk is tried.
    #[arg(long, value_name = "DIR", default_value = ".")]
    folder: PathBuf,
}

/// Something is bad.
const EXIT_BAD: u8 = 2;

/// Says what stands in the way of a recording.
pub(super) fn run_doctor(args: &DoctorArgs, json: bool) -> anyhow::Result<ExitCode> {
    let findings = examine(
        &Roots::default(),
        &Identity::own(),
        &args.folder,
        HostClock::default(),
    );
    let count = |severity| {
        findings
            .iter()
            .filter(|finding| finding.severity == severity)
            .count()
    };
    let (bad, warnings) = (count(Severity::Bad), count(Severity::Warning));
    for finding in &findings {
        say(finding, json)?;
    }
    if json {
        println!(
            "{}",
            json!({"event": "summary", "bad": bad, "warnings": warnings})
        );
    } else {
        println!("{bad} bad, {warnings} warnings");
    }
    Ok(if bad == 0 {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(EXIT_BAD)
    })
}

fn say(finding: &Finding, json: bool) -> anyhow::Result<()> {
    if json {
        println!("{}", super::with_event(finding, "finding")?);
        return Ok(());
    }
    println!(
        "{:<8} {:<14} {}",
        finding.severity.to_string(),
        finding.check,
        finding.words
    );
    if let Some(mend) = &finding.mend {
        println!("{:<8} {:<14} -> {mend}", "", "");
    }
    Ok(())
}

/// Says which cameras are plugged in.
#[cfg(feature = "usb")]
pub(super) fn run_list(json: bool) -> anyhow::Result<ExitCode> {
    let cameras = crate::ps1080::libusb::list()?;
    for camera in &cameras {
        if json {
            println!("{}", super::with_event(camera, "camera")?);
            continue;
        }
        println!(
            "{} ({}): serial {}, firmware {}, bus {} address {}, {} speed\n  ps1080:{}",
            camera.product,
            camera.usb_id,
            or_unknown(&camera.serial),
            or_unknown(&camera.firmware),
            camera.bus,
            camera.address,
            camera.speed,
            camera.path
        );
        if let Some(problem) = &camera.problem {
            println!("  {problem}");
        }
    }
    if json {
        println!("{}", json!({"event": "summary", "cameras": cameras.len()}));
    } else if cameras.is_empty() {
        println!("no camera is plugged in");
    }
    Ok(ExitCode::SUCCESS)
}

#[cfg(feature = "usb")]
fn or_unknown(text: &str) -> &str {
    if text.is_empty() { "unknown" } else { text }
}
