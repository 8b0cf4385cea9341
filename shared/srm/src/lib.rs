//! srm
