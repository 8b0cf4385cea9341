//! Why a mesh cannot be traced.

/// A mesh that is not one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RaytraceError {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {vertex_count} vertices")]
    VertexIndex {
        /// The triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Vertices given.
        vertex_count: usize,
    },
    /// More triangles than 31-bit indices can name.
    #[error("{triangle_count} triangles are more than a scene can hold")]
    TooManyTriangles {
        /// Triangles given.
        triangle_count: usize,
    },
}
