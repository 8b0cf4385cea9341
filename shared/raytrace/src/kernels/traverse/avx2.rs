pub(super) use super::scalar::trace;
