//! Shaders, and the structures and constants that they share with the program.

use std::fmt;

/// A WGSL module: shared texts, followed by a method's own text.
#[derive(Debug)]
pub struct Shader {
    /// Name in messages: that of the method's file.
    pub name: &'static str,
    /// Constants of the program that the shader uses; declared before its parts.
    pub constants: &'static [(&'static str, Constant)],
    /// Texts of the module, in order.
    pub parts: &'static [&'static str],
    /// Structures that the shader shares with the program.
    pub structs: &'static [Layout],
}

impl Shader {
    /// The text of the whole module.
    pub fn source(&self) -> String {
        let constants = self.constants.iter().map(|(name, value)| format!("const {name} = {value};\n"));
        constants.collect::<String>() + &self.parts.join("\n")
    }
}

/// A named constant of the program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Constant {
    /// `i32`.
    Int(i32),
    /// `u32`.
    Uint(u32),
    /// `f32`.
    Float(f32),
}

impl fmt::Display for Constant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Int(value) => write!(f, "i32({value})"),
            Self::Uint(value) => write!(f, "u32({value})"),
            Self::Float(value) => write!(f, "f32({value:e})"),
        }
    }
}

/// Layout of a structure in the program: consecutive members of four bytes each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Name of the structure.
    pub name: &'static str,
    /// Names and types of the members.
    pub members: &'static [(&'static str, ScalarKind)],
}

/// Type of a member.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScalarKind {
    /// `i32`.
    Int,
    /// `u32`.
    Uint,
    /// `f32`.
    Float,
}

/// A member of a structure that shaders read.
pub(crate) trait Scalar: Copy {
    /// Type of the member.
    const KIND: ScalarKind;

    /// Bits of the value.
    fn bits(self) -> u32;
}

impl Scalar for u32 {
    const KIND: ScalarKind = ScalarKind::Uint;

    fn bits(self) -> u32 {
        self
    }
}

impl Scalar for i32 {
    const KIND: ScalarKind = ScalarKind::Int;

    fn bits(self) -> u32 {
        self as u32
    }
}

impl Scalar for f32 {
    const KIND: ScalarKind = ScalarKind::Float;

    fn bits(self) -> u32 {
        self.to_bits()
    }
}

/// A structure that shaders read; see [`mirrored!`].
pub(crate) trait Mirrored {
    /// Name and layout, which have to be the same in the shader.
    const LAYOUT: Layout;

    /// Bits of the members, in order.
    fn words(&self) -> Vec<u32>;
}

/// Declares a structure that a shader declares too, with members of type `u32`, `i32` or `f32`. Its [`Layout`] has to be added to
/// [`Shader::structs`], so that a test compares it with the shader's.
macro_rules! mirrored {
    ($(#[$of_struct:meta])* $visibility:vis struct $name:ident {
        $($(#[$of_member:meta])* $member:ident: $scalar:ty),* $(,)?
    }) => {
        $(#[$of_struct])*
        #[derive(Debug, Clone, Copy)]
        $visibility struct $name {
            $($(#[$of_member])* $visibility $member: $scalar),*
        }

        impl $crate::gpu::Mirrored for $name {
            const LAYOUT: $crate::gpu::Layout = $crate::gpu::Layout {
                name: stringify!($name),
                members: &[$((stringify!($member), <$scalar as $crate::gpu::Scalar>::KIND)),*],
            };

            fn words(&self) -> Vec<u32> {
                vec![$($crate::gpu::Scalar::bits(self.$member)),*]
            }
        }
    };
}

pub(crate) use mirrored;
