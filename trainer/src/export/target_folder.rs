//! A folder that is complete or not there: written beside its name, then renamed.

use std::fs::{self, File, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use tempfile::TempDir;

/// A folder that is being written. Dropped before [`TargetFolder::finish`], it leaves nothing.
pub(crate) struct TargetFolder {
    part: TempDir,
    output: PathBuf,
}

impl TargetFolder {
    /// Begins the folder that will be `output`; refuses one that is there and not empty.
    pub(crate) fn begin(output: &Path) -> anyhow::Result<Self> {
        require_free(output)?;
        let parent = parent_of(output);
        fs::create_dir_all(parent).with_context(|| format!("cannot make {}", parent.display()))?;
        let part = tempfile::Builder::new()
            .prefix(".glint-")
            .suffix(".part")
            // As any program's folders: the umask decides. Temporary folders would be private.
            .permissions(Permissions::from_mode(0o777))
            .tempdir_in(parent)
            .with_context(|| format!("cannot write in {}", parent.display()))?;
        Ok(Self {
            part,
            output: output.to_path_buf(),
        })
    }

    /// Where a file inside lies until the folder has its name.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.part.path().join(name)
    }

    /// Makes a folder inside.
    pub(crate) fn make(&self, name: &str) -> anyhow::Result<()> {
        let path = self.part.path().join(name);
        fs::create_dir(&path).with_context(|| format!("cannot make {}", self.named(name)))
    }

    /// Writes a file inside.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        let path = self.part.path().join(name);
        fs::write(&path, bytes).with_context(|| format!("cannot write {}", self.named(name)))
    }

    /// Makes the folder durable and gives it its name.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        let cannot = || format!("cannot write {}", self.output.display());
        // One call for thousands of files.
        rustix::fs::syncfs(File::open(self.part.path())?).with_context(cannot)?;
        require_free(&self.output)?;
        // Replaces an empty folder, and refuses one that was filled meanwhile.
        fs::rename(self.part.path(), &self.output).with_context(cannot)?;
        File::open(parent_of(&self.output))?.sync_all()?;
        // Moved away: there is nothing left to remove.
        let _ = self.part.keep();
        Ok(())
    }

    fn named(&self, name: &str) -> String {
        self.output.join(name).display().to_string()
    }
}

fn require_free(output: &Path) -> anyhow::Result<()> {
    match fs::symlink_metadata(output) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => bail!("{}: {error}; is the path right?", output.display()),
        Ok(metadata) if metadata.is_dir() => {}
        Ok(_) => bail!(
            "{} exists and is no folder: give the name of a new folder with -o",
            output.display()
        ),
    }
    let mut entries =
        fs::read_dir(output).with_context(|| format!("cannot read {}", output.display()))?;
    if entries.next().is_some() {
        bail!(
            "{} is a folder that is not empty: give the name of a new folder with -o",
            output.display()
        );
    }
    Ok(())
}

fn parent_of(output: &Path) -> &Path {
    match output.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}
