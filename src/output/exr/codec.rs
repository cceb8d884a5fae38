//! Compression of EXR files.

use crate::error::Error;
use exr::compression::Compression;
use std::fmt;
use std::str::FromStr;

/// A compression that can be written. The EXR library cannot write HTJ2K and ZSTD.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Codec {
    /// No compression.
    None,
    /// Run-length encoding; lossless.
    Rle,
    /// Deflate, one scan line per block; lossless.
    Zips,
    /// Deflate, 16 scan lines per block; lossless.
    #[default]
    Zip,
    /// Wavelets; lossless, small files for grainy pictures.
    Piz,
    /// Deflate with floats rounded to 24 bits; lossless for half and integers.
    Pxr24,
    /// Fixed-size blocks for half; lossy.
    B44,
    /// B44 with smaller flat blocks; lossy.
    B44a,
    /// Cosine transform, 32 scan lines per block; lossy.
    Dwaa,
    /// Cosine transform, 256 scan lines per block; lossy.
    Dwab,
}

impl Codec {
    /// Every codec.
    pub const ALL: [Self; 10] = [
        Self::None,
        Self::Rle,
        Self::Zips,
        Self::Zip,
        Self::Piz,
        Self::Pxr24,
        Self::B44,
        Self::B44a,
        Self::Dwaa,
        Self::Dwab,
    ];

    /// The name in flags and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Rle => "rle",
            Self::Zips => "zips",
            Self::Zip => "zip",
            Self::Piz => "piz",
            Self::Pxr24 => "pxr24",
            Self::B44 => "b44",
            Self::B44a => "b44a",
            Self::Dwaa => "dwaa",
            Self::Dwab => "dwab",
        }
    }

    /// Rows of a block, which are compressed together.
    pub fn block_rows(self) -> usize {
        self.compression().scan_lines_per_block()
    }

    pub(super) fn compression(self) -> Compression {
        match self {
            Self::None => Compression::Uncompressed,
            Self::Rle => Compression::RLE,
            Self::Zips => Compression::ZIP1,
            Self::Zip => Compression::ZIP16,
            Self::Piz => Compression::PIZ,
            Self::Pxr24 => Compression::PXR24,
            Self::B44 => Compression::B44,
            Self::B44a => Compression::B44A,
            Self::Dwaa => Compression::DWAA(None),
            Self::Dwab => Compression::DWAB(None),
        }
    }
}

impl fmt::Display for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Codec {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        Self::ALL.into_iter().find(|codec| codec.name() == name).ok_or_else(|| {
            Error::settings(format!("there is no EXR compression called {name:?}"))
                .with("known", Self::ALL.map(Self::name).join(", "))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_codec_is_found_by_its_name_and_serialised_as_it() {
        for codec in Codec::ALL {
            assert_eq!(codec.name().parse::<Codec>().unwrap(), codec);
            assert_eq!(serde_json::to_value(codec).unwrap(), codec.name());
        }
        assert!("gif".parse::<Codec>().unwrap_err().to_string().contains("known: none, rle, zips, zip"));
    }
}
