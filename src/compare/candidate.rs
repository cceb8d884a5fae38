//! The candidates of a comparison: methods with settings.

use crate::error::Error;
use crate::methods::{Method, Registry, Role};
use crate::settings::{Effort, Origin, Settings, Sourced};
use std::fmt;

/// A method with settings: `NAME`, `NAME:VIEWS`, `NAME:KEY=VALUE`, several settings joined by `+`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Candidate {
    /// The method.
    pub method: &'static dyn Method,
    /// Lens samples per pixel; `None` for the method's own number.
    pub views: Option<usize>,
    /// Parameters of the method, `KEY=VALUE` each; those of the job where none is given.
    pub parameters: Vec<String>,
}

impl Candidate {
    /// Parses `NAME`, `NAME:VIEWS` or `NAME:KEY=VALUE`, with the methods of `registry`.
    ///
    /// # Errors
    /// An unknown method, an unknown key, a value that the parameter does not accept, and a number of views that is not a number.
    pub fn parse(text: &str, registry: &Registry) -> Result<Self, Error> {
        let (name, settings) = text.split_once(':').unwrap_or((text, ""));
        Self::with_settings(registry.by_name(name)?, settings)
    }

    /// `method` with `settings`, the text after the colon: several are joined by `+`.
    fn with_settings(method: &'static dyn Method, settings: &str) -> Result<Self, Error> {
        let mut candidate = Self { method, views: None, parameters: Vec::new() };
        for setting in settings.split('+').filter(|setting| !setting.is_empty()) {
            if setting.contains('=') {
                method.parameters().parse(method.name(), setting)?;
                candidate.parameters.push(setting.to_owned());
            } else {
                let views = setting.parse().map_err(|_| {
                    Error::settings("expected a number of views or KEY=VALUE after the method's name")
                        .with("found", format!("{method}:{settings}"))
                        .help("write shear:64, point-splat:accelerated=false, or the name alone")
                })?;
                candidate.views = Some(views);
            }
        }
        Ok(candidate)
    }
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let views = self.views.iter().map(ToString::to_string);
        let settings: Vec<String> = views.chain(self.parameters.iter().cloned()).collect();
        f.write_str(self.method.name())?;
        if settings.is_empty() { Ok(()) } else { write!(f, ":{}", settings.join("+")) }
    }
}

impl Candidate {
    /// Every quality level of `method`, from coarse to fine.
    ///
    /// # Errors
    /// A quality level that the method declares but does not accept; built-in methods have none.
    pub fn quality_levels(method: &'static dyn Method) -> Result<Vec<Self>, Error> {
        method.info().steps.iter().map(|level| Self::with_settings(method, level)).collect()
    }

    /// Every quality level of every method of `registry`, except the reference, which the others are measured against.
    ///
    /// # Errors
    /// Those of [`Candidate::quality_levels`].
    pub fn all(registry: &Registry) -> Result<Vec<Self>, Error> {
        let measured = registry.iter().filter(|method| method.info().role != Role::Reference);
        let levels = measured.map(Self::quality_levels).collect::<Result<Vec<_>, _>>()?;
        Ok(levels.concat())
    }

    /// The command-line flags that select this method with these settings.
    pub fn flags(&self) -> Vec<String> {
        let views = self.views.iter().flat_map(|views| ["--views".to_owned(), views.to_string()]);
        let parameters = self.parameters.iter().flat_map(|setting| ["--set".to_owned(), setting.clone()]);
        ["--method".to_owned(), self.method.name().to_owned()]
            .into_iter()
            .chain(views)
            .chain(parameters)
            .collect()
    }

    /// The candidate as the stem of a file name.
    pub fn file_stem(&self) -> String {
        self.to_string().replace([':', '=', '+'], "-")
    }

    /// `settings` with the candidate's method, views and parameters.
    ///
    /// # Errors
    /// Those of [`crate::settings::ParameterTable::parse`].
    pub fn settings(&self, settings: &Settings) -> Result<Settings, Error> {
        let (name, table) = (self.method.name(), self.method.parameters());
        let mut parameters = settings.parameters.clone();
        for setting in &self.parameters {
            parameters.push(table.parse(name, setting)?);
        }
        Ok(Settings {
            method: Sourced { value: name.to_owned(), origin: Origin::Flag },
            effort: Sourced { value: self.views.map(Effort::Views), origin: Origin::Flag },
            parameters,
            ..settings.clone()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::METHODS;
    use crate::settings::ParameterValues;

    fn parse(text: &str) -> Result<Candidate, Error> {
        Candidate::parse(text, &Registry::default())
    }

    #[test]
    fn a_candidate_is_a_method_with_or_without_settings() {
        let scatter = parse("scatter").unwrap();
        assert_eq!((scatter.method.name(), scatter.views, scatter.parameters.len()), ("scatter", None, 0));
        for text in ["scatter", "shear:64", "scatter:saturation=0.5", "layer-rays:8+cones=false"] {
            assert_eq!(parse(text).unwrap().to_string(), text);
        }
        assert!(parse("sheer").unwrap_err().to_string().contains("did you mean 'shear'?"));
        assert!(parse("shear:many").unwrap_err().to_string().contains("number of views"));
        assert!(parse("scatter:cones=true").unwrap_err().to_string().contains("no parameter 'cones'"));
    }

    #[test]
    fn the_flags_of_a_candidate_render_its_picture() {
        let candidate = parse("layer-rays:8+cones=false").unwrap();
        assert_eq!(candidate.flags(), ["--method", "layer-rays", "--views", "8", "--set", "cones=false"]);
        assert_eq!(candidate.file_stem(), "layer-rays-8-cones-false");
    }

    #[test]
    fn every_method_has_at_least_three_quality_levels_and_all_of_them_parse() {
        for method in METHODS {
            let info = method.info();
            assert!(info.steps.len() >= 3, "{}", info.name);
            for level in info.steps {
                let candidate = parse(&format!("{}:{level}", info.name)).unwrap();
                let settings = Settings::resolve(&[], ParameterValues::default());
                let own = candidate.settings(&settings).unwrap();
                assert_eq!(own.method.value, info.name);
                assert_eq!(candidate.views.is_some(), own.effort.value.is_some());
                assert!(candidate.views.is_none() || method.samples_lens(), "{candidate}");
            }
        }
    }
}
