//! Tracking and fusing beside recording.

mod live;
mod scene;
mod slow;
