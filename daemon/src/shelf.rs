//! The folder of one camera's recordings: how they are named, and which are removed so that they stay within a bound.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Characters of a time in a name: `20261126T104530Z`.
const TIME_CHARACTERS: usize = 16;
const BLOCK_BYTES: u64 = 512;

/// Recordings of one camera in one folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shelf {
    folder: PathBuf,
    camera: String,
}

/// A recording that was removed, or should have been.
#[derive(Debug)]
pub struct Removed {
    /// The file.
    pub path: PathBuf,
    /// What it took on the disk.
    pub bytes: u64,
    /// Why it is still there, where it is.
    pub problem: Option<std::io::Error>,
}

/// A file on the shelf. Order is age: time of the recording, then the number of the part.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Book {
    time: String,
    part: u32,
    path: PathBuf,
    bytes: u64,
}

impl Shelf {
    /// Recordings of `camera` (as in file names) in `folder`.
    pub fn new(folder: &Path, camera: &str) -> Self {
        Self {
            folder: folder.to_path_buf(),
            camera: camera.to_owned(),
        }
    }

    /// A file for a recording that begins at `now`.
    ///
    /// # Errors
    /// A time before 1970.
    pub fn place(&self, now: SystemTime) -> Result<PathBuf, std::time::SystemTimeError> {
        let seconds = now.duration_since(SystemTime::UNIX_EPOCH)?.as_secs();
        let name = format!("{}-{}.glint", self.camera, utc_name(seconds));
        Ok(self.folder.join(name))
    }

    /// Removes files of this camera, oldest first, until they take `keep_bytes` or less. The newest file of the recording
    /// `current` is being written and stays, as does what is not named as recordings of this camera are.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn trim(&self, keep_bytes: u64, current: Option<&Path>) -> std::io::Result<Vec<Removed>> {
        let books = self.books()?;
        let current_time = current.and_then(|path| Some(self.parse(path)?.0));
        let written = current_time.and_then(|time| {
            let mine = books.iter().filter(|book| book.time == time);
            mine.map(|book| book.path.clone()).next_back()
        });
        let mut total: u64 = books.iter().map(|book| book.bytes).sum();
        let mut removed = Vec::new();
        for book in books {
            if total <= keep_bytes {
                break;
            }
            if Some(&book.path) == written.as_ref() {
                continue;
            }
            let problem = std::fs::remove_file(&book.path).err();
            if problem.is_none() {
                total -= book.bytes;
            }
            removed.push(Removed {
                path: book.path,
                bytes: book.bytes,
                problem,
            });
        }
        Ok(removed)
    }

    /// By age.
    fn books(&self) -> std::io::Result<Vec<Book>> {
        let mut books = Vec::new();
        for entry in std::fs::read_dir(&self.folder)? {
            let entry = entry?;
            let path = entry.path();
            let Some((time, part)) = self.parse(&path) else {
                continue;
            };
            // A link is somebody's; a file that has just gone takes nothing.
            match entry.metadata() {
                Ok(found) if found.is_file() => books.push(Book {
                    time,
                    part,
                    bytes: found.blocks() * BLOCK_BYTES,
                    path,
                }),
                _ => {}
            }
        }
        books.sort();
        Ok(books)
    }

    /// Time and number of the part, where this is the name of a recording of this camera.
    fn parse(&self, path: &Path) -> Option<(String, u32)> {
        let name = path.file_name()?.to_str()?;
        let rest = name.strip_prefix(&self.camera)?.strip_prefix('-')?;
        let rest = rest.strip_suffix(".glint")?;
        let (time, part) = rest.split_at_checked(TIME_CHARACTERS)?;
        let is_time = time.bytes().enumerate().all(|(index, byte)| match index {
            8 => byte == b'T',
            15 => byte == b'Z',
            _ => byte.is_ascii_digit(),
        });
        let part = match part.strip_prefix('-') {
            Some(number) => number.parse().ok()?,
            None if part.is_empty() => 1,
            None => return None,
        };
        is_time.then(|| (time.to_owned(), part))
    }
}

/// `20261126T104530Z` of seconds since 1970.
fn utc_name(seconds: u64) -> String {
    // Days to year, month, day by the civil calendar (Hinnant, "chrono-compatible date algorithms").
    let days = seconds / 86_400 + 719_468;
    let era = days / 146_097;
    let day_of_era = days % 146_097;
    let year_of_era =
        (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 {
        shifted_month + 3
    } else {
        shifted_month - 9
    };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: &str = "ps1080-1-2";
    /// What every file of these tests takes on most disks; not less anywhere.
    const BYTES: usize = 65_536;

    #[test]
    fn file_names_carry_the_utc_time() {
        assert_eq!(utc_name(0), "19700101T000000Z");
        assert_eq!(utc_name(951_782_400), "20000229T000000Z");
        assert_eq!(utc_name(1_798_761_599), "20261231T235959Z");
    }

    #[test]
    fn two_cameras_get_two_files() {
        let now = SystemTime::UNIX_EPOCH;
        let place = |camera| Shelf::new(Path::new("/x"), camera).place(now).unwrap();
        assert_eq!(
            place(CAMERA),
            Path::new("/x/ps1080-1-2-19700101T000000Z.glint")
        );
        assert_ne!(place(CAMERA), place("ps1080-1-2.1"));
    }

    fn filled(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            // No disk makes less of bytes that do not repeat.
            let mut seed = 1_u32;
            let bytes: Vec<u8> = (0..BYTES)
                .map(|_| {
                    seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (seed >> 24) as u8
                })
                .collect();
            let file = std::fs::File::create(folder.path().join(name)).unwrap();
            std::io::Write::write_all(&mut &file, &bytes).unwrap();
            // Blocks are counted once they are given out.
            file.sync_all().unwrap();
        }
        folder
    }

    fn removed(folder: &Path, keep: u64, current: Option<&str>) -> Vec<String> {
        let current = current.map(|name| folder.join(name));
        let removed = Shelf::new(folder, CAMERA)
            .trim(keep, current.as_deref())
            .unwrap();
        let name = |removed: Removed| {
            assert!(removed.problem.is_none());
            assert!(!removed.path.exists());
            removed
                .path
                .file_name()
                .unwrap()
                .to_str()
                .unwrap()
                .to_owned()
        };
        removed.into_iter().map(name).collect()
    }

    #[test]
    fn the_oldest_go_first_by_time_and_part() {
        let names = [
            "ps1080-1-2-20261126T104530Z.glint",
            "ps1080-1-2-20261126T104530Z-1000.glint",
            "ps1080-1-2-20261126T104530Z-002.glint",
            "ps1080-1-2-20251126T104530Z.glint",
        ];
        let folder = filled(&names);
        assert_eq!(removed(folder.path(), 1 << 40, None), [""; 0]);
        let expected = [names[3], names[0], names[2], names[1]];
        assert_eq!(removed(folder.path(), 0, None), expected);
    }

    #[test]
    fn only_what_is_needed_goes() {
        let names = [
            "ps1080-1-2-20251126T104530Z.glint",
            "ps1080-1-2-20261126T104530Z.glint",
        ];
        let folder = filled(&names);
        let bytes = Shelf::new(folder.path(), CAMERA).books().unwrap()[1].bytes;
        assert_eq!(removed(folder.path(), bytes, None), [names[0]]);
        assert_eq!(removed(folder.path(), bytes, None), [""; 0]);
    }

    #[test]
    fn the_part_that_is_being_written_stays_though_it_alone_is_too_much() {
        let names = [
            "ps1080-1-2-20261126T104530Z.glint",
            "ps1080-1-2-20261126T104530Z-002.glint",
            // From a time when the clock was wrong.
            "ps1080-1-2-20991126T104530Z.glint",
        ];
        let folder = filled(&names);
        let gone = removed(folder.path(), 0, Some(names[0]));
        assert_eq!(gone, [names[0], names[2]]);
        assert!(folder.path().join(names[1]).exists());
    }

    #[test]
    fn nothing_else_is_touched() {
        let names = [
            "ps1080-1-2.1-20261126T104530Z.glint",
            "ps1080-1-20261126T104530Z.glint",
            "ps1080-1-2-20261126T104530Z.glint.keep",
            "ps1080-1-2-20261126T104530Z-best.glint",
            "ps1080-1-2-20261126T10453.glint",
            "kitchen.glint",
        ];
        let folder = filled(&names);
        std::os::unix::fs::symlink(
            folder.path().join(names[5]),
            folder.path().join("ps1080-1-2-20200101T000000Z.glint"),
        )
        .unwrap();
        assert_eq!(removed(folder.path(), 0, None), [""; 0]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 7);
    }
}
