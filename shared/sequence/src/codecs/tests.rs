//! Hard cases and hostile input of the codecs.
