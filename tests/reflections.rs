//! Reflections that the lens moves, against ray tracing of mirrors ([`tracer`]) and against closed forms.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

#[expect(dead_code, reason = "other tests use the rest")]
mod fixtures;
#[path = "reflections/closed_forms.rs"]
mod closed_forms;
#[path = "reflections/hard_cases.rs"]
mod hard_cases;
#[path = "reflections/light.rs"]
mod light;
#[path = "reflections/plan.rs"]
mod plan;
#[path = "reflections/tracer.rs"]
mod tracer;
