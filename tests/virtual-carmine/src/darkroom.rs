//! Payloads, kept as long as the film repeats: a camera at 30 frames a second must not cost the host a core.

use std::collections::HashMap;
use std::sync::Arc;

use crate::faults::Deviation;
use crate::film::Film;
use crate::shot::Shot;

/// Most bytes that are kept: two seconds of VGA in two streams.
const KEPT_BYTES: usize = 96 << 20;

pub(crate) struct Darkroom {
    film: Box<dyn Film>,
    deviation: Option<Deviation>,
    kept: HashMap<(Shot, u64), Arc<[u8]>>,
    kept_bytes: usize,
}

impl Darkroom {
    pub(crate) fn new(film: Box<dyn Film>, deviation: Option<Deviation>) -> Self {
        Self {
            film,
            deviation,
            kept: HashMap::new(),
            kept_bytes: 0,
        }
    }

    /// The payload of frame `index`, or `None` where the film has no such picture.
    pub(crate) fn payload(&mut self, shot: Shot, index: u64) -> Option<Arc<[u8]>> {
        let key = (shot, index % self.film.cycle().max(1));
        if let Some(payload) = self.kept.get(&key) {
            return Some(Arc::clone(payload));
        }
        let payload = shot.develop(self.film.as_mut(), key.1, self.deviation)?;
        let payload = Arc::<[u8]>::from(payload);
        if self.kept_bytes + payload.len() > KEPT_BYTES {
            self.kept.clear();
            self.kept_bytes = 0;
        }
        self.kept_bytes += payload.len();
        self.kept.insert(key, Arc::clone(&payload));
        Some(payload)
    }
}
