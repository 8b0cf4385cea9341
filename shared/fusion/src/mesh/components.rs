//! Connected parts of a mesh.

use super::Mesh;

/// One label per vertex: two vertices have the same label exactly when edges connect them.
/// Labels count up from 0 in the order of each part's first vertex.
pub fn components(mesh: &Mesh) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    for &[a, b, c] in &mesh.triangles {
        unite(&mut parent, a, b);
        unite(&mut parent, b, c);
    }
    let mut label_of_root = vec![u32::MAX; parent.len()];
    let mut next = 0;
    (0..parent.len() as u32)
        .map(|vertex| {
            let label = &mut label_of_root[root(&mut parent, vertex) as usize];
            if *label == u32::MAX {
                *label = next;
                next += 1;
            }
            *label
        })
        .collect()
}

/// Removes the parts with fewer than `min_triangles` triangles, and vertices without a triangle; the rest
/// keeps its order. Returns the number of triangles removed.
pub fn remove_small_components(mesh: &mut Mesh, min_triangles: usize) -> usize {
    let labels = components(mesh);
    let mut size = vec![0usize; labels.iter().max().map_or(0, |&last| last as usize + 1)];
    for triangle in &mesh.triangles {
        size[labels[triangle[0] as usize] as usize] += 1;
    }
    let least = min_triangles.max(1);
    mesh.retain_vertices(|vertex| size[labels[vertex] as usize] >= least)
}

impl Mesh {
    /// Keeps the vertices that `keeps` (by index) accepts and the triangles between them.
    /// Returns the number of triangles removed.
    pub fn retain_vertices(&mut self, keeps: impl Fn(usize) -> bool) -> usize {
        let mut renumbered = vec![u32::MAX; self.positions.len()];
        let mut kept = 0usize;
        for (vertex, number) in renumbered.iter_mut().enumerate() {
            if keeps(vertex) {
                *number = kept as u32;
                self.positions[kept] = self.positions[vertex];
                self.normals[kept] = self.normals[vertex];
                self.weights[kept] = self.weights[vertex];
                if !self.radiance.is_empty() {
                    self.radiance[kept] = self.radiance[vertex];
                }
                kept += 1;
            }
        }
        self.positions.truncate(kept);
        self.normals.truncate(kept);
        self.weights.truncate(kept);
        self.radiance.truncate(kept);
        let before = self.triangles.len();
        self.triangles.retain_mut(|triangle| {
            *triangle = triangle.map(|vertex| renumbered[vertex as usize]);
            !triangle.contains(&u32::MAX)
        });
        before - self.triangles.len()
    }
}

fn unite(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parent, a), root(parent, b));
    // The smaller root wins, so that the result does not depend on the order of triangles.
    parent[a.max(b) as usize] = a.min(b);
}

fn root(parent: &mut [u32], mut vertex: u32) -> u32 {
    while parent[vertex as usize] != vertex {
        let above = parent[parent[vertex as usize] as usize];
        parent[vertex as usize] = above;
        vertex = above;
    }
    vertex
}
