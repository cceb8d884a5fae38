//! Published methods: five papers, and the four baselines that they compare themselves with.

pub(super) mod b_buffer;
pub(super) mod gather;
pub(super) mod layer_rays;
pub(super) mod opaque_blur;
pub(super) mod peel_rays;
pub(super) mod point_splat;
pub(super) mod pyramid_disocclusion;
pub(super) mod recursive_gaussian;
pub(super) mod scatter;
