//! Every shader is valid, translates to the language of every driver, and has the structures of the program; no GPU is needed.

#![cfg(feature = "gpu")]

use naga::back::pipeline_constants::process_overrides;
use naga::back::{PipelineConstants, hlsl, msl, spv};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Module, ScalarKind as NagaKind, TypeInner};
use thinlens::gpu::{Layout, ScalarKind, Shader};
use thinlens::methods::METHODS;

/// The shaders of all methods; fails if there is none.
fn shaders() -> Vec<&'static Shader> {
    let shaders: Vec<_> =
        METHODS.iter().filter_map(|method| method.gpu()).map(|backend| backend.shader()).collect();
    assert!(!shaders.is_empty(), "no method has a GPU backend");
    shaders
}

/// The shader parsed and validated, as WGSL without any extension.
fn module(shader: &Shader) -> (Module, ModuleInfo) {
    let source = shader.source();
    let module = naga::front::wgsl::parse_str(&source)
        .unwrap_or_else(|error| panic!("{}: {}", shader.name, error.emit_to_string(&source)));
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|error| panic!("{}: {}", shader.name, error.emit_to_string(&source)));
    (module, info)
}

#[test]
fn every_shader_translates_to_vulkan_metal_and_dx12() {
    for shader in shaders() {
        let (module, info) = module(shader);
        assert!(!module.entry_points.is_empty(), "{} has entry points", shader.name);
        // The target languages lack WGSL's overridable constants, so these are resolved first.
        let (module, info) = process_overrides(&module, &info, None, &PipelineConstants::default()).unwrap();
        let spirv = spv::write_vec(&module, &info, &spv::Options::default(), None).unwrap();
        assert_eq!(spirv.first(), Some(&0x0723_0203), "{}: SPIR-V's magic number", shader.name);
        let options =
            msl::Options { lang_version: (2, 4), fake_missing_bindings: true, ..msl::Options::default() };
        let (metal, _) =
            msl::write_string(&module, &info, &options, &msl::PipelineOptions::default()).unwrap();
        let mut text = String::new();
        let options = hlsl::Options {
            shader_model: hlsl::ShaderModel::V6_0,
            fake_missing_bindings: true,
            ..hlsl::Options::default()
        };
        let pipeline_options = hlsl::PipelineOptions::default();
        hlsl::Writer::new(&mut text, &options, &pipeline_options).write(&module, &info, None).unwrap();
        for entry in &module.entry_points {
            assert!(
                metal.contains(&entry.name) && text.contains(&entry.name),
                "{}: {}",
                shader.name,
                entry.name
            );
        }
    }
}

/// The difference between `layout` and the struct of its name in `module`, if any.
fn mismatch(module: &Module, layout: &Layout) -> Option<String> {
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(layout.name));
    let Some((_, ty)) = found else { return Some(format!("there is no struct {}", layout.name)) };
    let TypeInner::Struct { members, span } = &ty.inner else {
        return Some(format!("{} is no struct", layout.name));
    };
    let kind = |kind: ScalarKind| match kind {
        ScalarKind::Int => NagaKind::Sint,
        ScalarKind::Uint => NagaKind::Uint,
        ScalarKind::Float => NagaKind::Float,
    };
    let expected: Vec<_> = layout
        .members
        .iter()
        .enumerate()
        .map(|(i, &(name, scalar))| (name.to_owned(), 4 * i as u32, Some((kind(scalar), 4))))
        .collect();
    let found: Vec<_> = members
        .iter()
        .map(|member| {
            let scalar = match module.types[member.ty].inner {
                TypeInner::Scalar(scalar) => Some((scalar.kind, scalar.width)),
                _ => None,
            };
            (member.name.clone().unwrap_or_default(), member.offset, scalar)
        })
        .collect();
    let size = 4 * layout.members.len() as u32;
    (found != expected || *span != size).then(|| format!("{}: {found:?} is not {expected:?}", layout.name))
}

#[test]
fn structures_have_the_same_layout_in_shaders_and_in_the_program() {
    for shader in shaders() {
        let (module, _) = module(shader);
        for layout in shader.structs {
            assert_eq!(mismatch(&module, layout), None, "{}", shader.name);
        }
        // Arrays of vectors need no check: their layout is the same everywhere.
        let uniforms = module
            .global_variables
            .iter()
            .filter(|(_, variable)| variable.space == naga::AddressSpace::Uniform)
            .filter(|(_, variable)| matches!(module.types[variable.ty].inner, TypeInner::Struct { .. }));
        for (_, variable) in uniforms {
            let name = module.types[variable.ty].name.clone().unwrap_or_default();
            let known = shader.structs.iter().any(|layout| layout.name == name);
            assert!(known, "{}: {name} is not among the structures that the program declares", shader.name);
        }
    }
}

#[test]
fn a_structure_that_differs_is_found() {
    let module = naga::front::wgsl::parse_str(
        "struct Params { width: u32, radius: f32 }
        @group(0) @binding(0) var<uniform> params: Params;",
    )
    .unwrap();
    let differs = |members: &'static [(&'static str, ScalarKind)]| {
        mismatch(&module, &Layout { name: "Params", members }).is_some()
    };
    const WIDTH: (&str, ScalarKind) = ("width", ScalarKind::Uint);
    const RADIUS: (&str, ScalarKind) = ("radius", ScalarKind::Float);
    assert!(!differs(&[WIDTH, RADIUS]), "the same");
    assert!(differs(&[RADIUS, WIDTH]), "another order");
    assert!(differs(&[WIDTH, ("radius", ScalarKind::Uint)]), "another type");
    assert!(differs(&[WIDTH]), "a member too few");
    assert!(differs(&[WIDTH, ("reach", ScalarKind::Float)]), "another name");
}
