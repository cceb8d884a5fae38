//! Who takes part in a comparison: a method with settings of its own.

use crate::error::Error;
use crate::methods::{self, METHODS};
use crate::settings::{Effort, MethodParameters, Origin, Settings, Sourced};
use std::fmt;
use std::str::FromStr;

/// A method with settings: `NAME`, `NAME:VIEWS`, `NAME:KEY=VALUE`, several settings joined by `+`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Contender {
    /// Name of the method.
    pub method: &'static str,
    /// Lens samples a pixel; the method's own number where none is given.
    pub views: Option<usize>,
    /// Parameters of the method, `KEY=VALUE` each; the job's own where none is given.
    pub parameters: Vec<String>,
}

impl FromStr for Contender {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let (name, settings) = text.split_once(':').unwrap_or((text, ""));
        let mut contender =
            Self { method: methods::by_name(name)?.info().name, views: None, parameters: Vec::new() };
        for setting in settings.split('+').filter(|setting| !setting.is_empty()) {
            if setting.contains('=') {
                MethodParameters::default().set(contender.method, setting)?;
                contender.parameters.push(setting.to_owned());
            } else {
                let views = setting.parse().map_err(|_| {
                    Error::settings("a method's name is followed by a number of views, or by KEY=VALUE")
                        .with("found", text)
                        .help("write shear:64, point-splat:accelerated=false, or the name alone")
                })?;
                contender.views = Some(views);
            }
        }
        Ok(contender)
    }
}

impl fmt::Display for Contender {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let views = self.views.iter().map(ToString::to_string);
        let settings: Vec<String> = views.chain(self.parameters.iter().cloned()).collect();
        f.write_str(self.method)?;
        if settings.is_empty() { Ok(()) } else { write!(f, ":{}", settings.join("+")) }
    }
}

impl Contender {
    /// Every step of the method called `method`, from rough to fine.
    ///
    /// # Errors
    /// An unknown method.
    pub fn steps_of(method: &str) -> Result<Vec<Self>, Error> {
        let info = methods::by_name(method)?.info();
        info.steps.iter().map(|step| format!("{}:{step}", info.name).parse()).collect()
    }

    /// Every step of every method but the reference, which is the truth that the others are measured by.
    ///
    /// # Panics
    /// Never: the steps of a method are contenders, which is tested.
    pub fn all() -> Vec<Self> {
        let infos = METHODS.iter().map(|method| method.info()).filter(|info| info.role != "reference");
        infos
            .flat_map(|info| Self::steps_of(info.name).expect("the steps of a method are contenders"))
            .collect()
    }

    /// The words of a command line that choose this method with these settings.
    pub fn flags(&self) -> Vec<String> {
        let views = self.views.iter().flat_map(|views| ["--views".to_owned(), views.to_string()]);
        let parameters = self.parameters.iter().flat_map(|setting| ["--set".to_owned(), setting.clone()]);
        ["--method".to_owned(), self.method.to_owned()].into_iter().chain(views).chain(parameters).collect()
    }

    /// The contender as the beginning of a file's name.
    pub fn file_stem(&self) -> String {
        self.to_string().replace([':', '=', '+'], "-")
    }

    /// The contender's settings, for the rest `settings`.
    ///
    /// # Errors
    /// Those of [`MethodParameters::set`].
    pub fn settings(&self, settings: &Settings) -> Result<Settings, Error> {
        let mut parameters = settings.parameters.clone();
        self.parameters.iter().try_for_each(|setting| parameters.set(self.method, setting))?;
        Ok(Settings {
            method: Sourced { value: self.method.to_owned(), origin: Origin::Flag },
            effort: Sourced { value: self.views.map(Effort::Views), origin: Origin::Flag },
            parameters,
            ..settings.clone()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Contender, Error> {
        text.parse()
    }

    #[test]
    fn a_contender_is_a_method_with_or_without_settings() {
        let scatter = parse("scatter").unwrap();
        assert_eq!((scatter.method, scatter.views, scatter.parameters.len()), ("scatter", None, 0));
        for text in ["scatter", "shear:64", "scatter:saturation=0.5", "layer-rays:8+cones=false"] {
            assert_eq!(parse(text).unwrap().to_string(), text);
        }
        assert!(parse("sheer").unwrap_err().to_string().contains("did you mean 'shear'?"));
        assert!(parse("shear:many").unwrap_err().to_string().contains("number of views"));
        assert!(parse("scatter:cones=true").unwrap_err().to_string().contains("no parameter 'cones'"));
    }

    #[test]
    fn a_contender_is_a_render_with_flags() {
        let contender = parse("layer-rays:8+cones=false").unwrap();
        assert_eq!(contender.flags(), ["--method", "layer-rays", "--views", "8", "--set", "cones=false"]);
        assert_eq!(contender.file_stem(), "layer-rays-8-cones-false");
    }

    #[test]
    fn every_method_has_three_steps_at_least_and_all_of_them_are_contenders() {
        for method in METHODS {
            let info = method.info();
            assert!(info.steps.len() >= 3, "{}", info.name);
            for step in info.steps {
                let contender = parse(&format!("{}:{step}", info.name)).unwrap();
                let settings = Settings::resolve(&[], MethodParameters::default());
                let own = contender.settings(&settings).unwrap();
                assert_eq!(own.method.value, info.name);
                assert_eq!(contender.views.is_some(), own.effort.value.is_some());
                assert!(
                    contender.views.is_none() || method.lens_samples(&own.parameters).is_some(),
                    "{contender}"
                );
            }
        }
    }
}
