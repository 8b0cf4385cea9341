//! Every function that a program may want is there.

use crate::api::Library;

/// What the driver of OpenNI2 imports (protocol section 10).
const OPENNI2: [&str; 25] = [
    "init",
    "exit",
    "get_device_list",
    "free_device_list",
    "get_device_descriptor",
    "get_bus_number",
    "get_device_address",
    "ref_device",
    "unref_device",
    "open",
    "close",
    "get_device",
    "claim_interface",
    "release_interface",
    "set_interface_alt_setting",
    "get_active_config_descriptor",
    "free_config_descriptor",
    "control_transfer",
    "bulk_transfer",
    "interrupt_transfer",
    "alloc_transfer",
    "free_transfer",
    "submit_transfer",
    "cancel_transfer",
    "handle_events_timeout",
];

/// What else rusb 0.9 refers to (its crate libusb1-sys 0.7).
const RUSB: [&str; 63] = [
    "get_version",
    "has_capability",
    "error_name",
    "setlocale",
    "strerror",
    "set_debug",
    "set_log_cb",
    "get_parent",
    "get_config_descriptor",
    "get_config_descriptor_by_value",
    "get_port_number",
    "get_port_numbers",
    "get_device_speed",
    "get_max_packet_size",
    "get_max_iso_packet_size",
    "wrap_sys_device",
    "open_device_with_vid_pid",
    "reset_device",
    "clear_halt",
    "alloc_streams",
    "free_streams",
    "get_string_descriptor_ascii",
    "get_configuration",
    "set_configuration",
    "get_ss_endpoint_companion_descriptor",
    "free_ss_endpoint_companion_descriptor",
    "get_bos_descriptor",
    "free_bos_descriptor",
    "get_usb_2_0_extension_descriptor",
    "free_usb_2_0_extension_descriptor",
    "get_ss_usb_device_capability_descriptor",
    "free_ss_usb_device_capability_descriptor",
    "get_container_id_descriptor",
    "free_container_id_descriptor",
    "set_auto_detach_kernel_driver",
    "kernel_driver_active",
    "detach_kernel_driver",
    "attach_kernel_driver",
    "transfer_set_stream_id",
    "transfer_get_stream_id",
    "handle_events",
    "handle_events_completed",
    "handle_events_timeout_completed",
    "handle_events_locked",
    "interrupt_event_handler",
    "try_lock_events",
    "lock_events",
    "unlock_events",
    "event_handling_ok",
    "event_handler_active",
    "lock_event_waiters",
    "unlock_event_waiters",
    "wait_for_event",
    "pollfds_handle_timeouts",
    "get_next_timeout",
    "get_pollfds",
    "set_pollfd_notifiers",
    "free_pollfds",
    "hotplug_register_callback",
    "hotplug_deregister_callback",
    "hotplug_get_user_data",
    "set_option",
    "init_context",
];

#[test]
fn every_function_of_openni2_and_rusb_is_there() {
    let library = Library::load();
    let absent: Vec<&str> = OPENNI2
        .into_iter()
        .chain(RUSB)
        .filter(|name| !library.has(&format!("libusb_{name}")))
        .collect();
    assert!(absent.is_empty(), "{absent:?}");
}
