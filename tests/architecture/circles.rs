//! No circles between the files of `src/`: each can be read with what it uses read before it.
//!
//! A file uses another when a path in its code ends at an item of the other's: `crate::a::B`, `super::B`, a name that a `use`
//! brought in. Re-exports are followed to the file that declares the item, so `pub use` and `mod` lines are no use by themselves.
//! Methods called on a value are not seen.

use super::{code_of, rust_files};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Modules from the crate's root to this one; empty for the root.
type ModulePath = Vec<String>;

/// What a module's code says.
#[derive(Debug, Default)]
struct Module {
    /// What each name stands for that a `use` brings in.
    names: BTreeMap<String, Vec<String>>,
    /// Paths that the code uses.
    used: Vec<Vec<String>>,
}

/// The modules of the library and of the program under one root: they have no name in common.
#[derive(Debug, Default)]
struct Modules(BTreeMap<ModulePath, Module>);

/// Which modules each module uses.
type Uses = BTreeMap<ModulePath, BTreeSet<ModulePath>>;

#[test]
fn no_file_uses_itself_by_way_of_others() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut modules = Modules::default();
    for file in rust_files(&source) {
        let text = fs::read_to_string(&file).unwrap();
        modules.add(module_path(file.strip_prefix(&source).unwrap()), &text);
    }
    let circles = circles(&modules.uses());
    assert!(circles.is_empty(), "files that use one another in a circle:\n{}", circles.join("\n"));
}

#[test]
fn a_circle_is_found_through_re_exports_and_in_groups() {
    let mut modules = Modules::default();
    modules.add(vec![], "pub mod gpu; pub mod error;");
    modules.add(path("gpu"), "mod context;\nmod memory;\npub use context::Gpu;\npub use memory::{Buffer};");
    modules.add(path("gpu::context"), "use crate::{error::Error, gpu::{self}};\nfn take(it: gpu::Buffer) {}");
    modules.add(path("gpu::memory"), "use super::Gpu as Adapter;\nstruct Buffer;");
    modules.add(path("error"), "// crate::gpu::Buffer\nstruct Error;");
    assert_eq!(circles(&modules.uses()), ["gpu::context -> gpu::memory", "gpu::memory -> gpu::context"]);
}

#[test]
fn a_parent_that_declares_and_re_exports_its_children_does_not_use_them() {
    let mut modules = Modules::default();
    modules.add(vec![], "pub mod lens;");
    modules.add(path("lens"), "mod rays;\npub use rays::Rays;\npub struct Lens;");
    modules.add(path("lens::rays"), "use super::Lens;\npub struct Rays(Lens);");
    assert_eq!(circles(&modules.uses()), [""; 0]);
    modules.add(path("lens"), "mod rays;\npub struct Lens;\nfn rays() { rays::Rays::new() }");
    assert_eq!(circles(&modules.uses()), ["lens -> lens::rays", "lens::rays -> lens"]);
}

impl Modules {
    fn add(&mut self, path: ModulePath, text: &str) {
        self.0.insert(path, Module::read(&code_of(text)));
    }

    fn uses(&self) -> Uses {
        let uses = |(path, module): (&ModulePath, &Module)| {
            let used = module.used.iter().filter_map(|used| self.declared_in(path, used));
            (path.clone(), used.filter(|used| used != path).collect())
        };
        self.0.iter().map(uses).collect()
    }

    /// The module that declares what `path` means in `module`; `None` where that is a module itself, or not of this crate.
    fn declared_in(&self, module: &ModulePath, path: &[String]) -> Option<ModulePath> {
        let (first, rest) = path.split_first()?;
        match first.as_str() {
            "crate" | "thinlens" => self.below(&Vec::new(), rest),
            "self" => self.below(module, rest),
            "super" => {
                let (_, parent) = module.split_last()?;
                self.declared_in(&parent.to_vec(), &[&["self".to_owned()], rest].concat())
            }
            name => match self.child(module, name) {
                Some(child) => self.below(&child, rest),
                None => {
                    let meaning = self.0.get(module)?.names.get(name)?;
                    // `use rayon::{self}`: another crate.
                    let of_others = meaning.first() == Some(first);
                    (!of_others).then(|| self.declared_in(module, &[meaning, rest].concat())).flatten()
                }
            },
        }
    }

    /// The same of a path that starts in `module` with a name of its own.
    fn below(&self, module: &ModulePath, path: &[String]) -> Option<ModulePath> {
        let (first, rest) = path.split_first()?;
        if first == "super" {
            return self.declared_in(module, path);
        }
        if let Some(meaning) = self.0.get(module)?.names.get(first) {
            return self.declared_in(module, &[meaning, rest].concat());
        }
        match self.child(module, first) {
            Some(child) => self.below(&child, rest),
            None => Some(module.clone()),
        }
    }

    fn child(&self, module: &ModulePath, name: &str) -> Option<ModulePath> {
        let child = [&module[..], &[name.to_owned()]].concat();
        self.0.contains_key(&child).then_some(child)
    }
}

impl Module {
    fn read(code: &str) -> Self {
        let tokens = tokens(code);
        let mut module = Self::default();
        let mut at = 0;
        while at < tokens.len() {
            let length = match tokens[at] {
                "use" => {
                    let exported = at > 0 && matches!(tokens[at - 1], "pub" | ")");
                    module.read_use(&tokens[at + 1..], exported)
                }
                _ => module.read_path(&tokens[at..]),
            };
            at += length.max(1);
        }
        module
    }

    /// Reads the declaration that follows a `use`, and returns how many tokens it has.
    fn read_use(&mut self, tokens: &[&str], exported: bool) -> usize {
        let end = tokens.iter().position(|token| *token == ";").unwrap_or(tokens.len());
        let mut leaves = Vec::new();
        leaves_of(&tokens[..end], &[], &mut leaves);
        for (name, path) in leaves {
            if !exported {
                self.used.push(path.clone());
            }
            self.names.insert(name, path);
        }
        end
    }

    /// Reads `a::b::C`, if that is what `tokens` start with, and returns how many tokens it has.
    fn read_path(&mut self, tokens: &[&str]) -> usize {
        let pairs = tokens.chunks(2).take_while(|pair| is_word(pair[0]));
        let mut path = Vec::new();
        for pair in pairs {
            path.push(pair[0].to_owned());
            if pair.get(1) != Some(&"::") {
                break;
            }
        }
        let length = (2 * path.len()).saturating_sub(1);
        if path.len() > 1 {
            self.used.push(path);
        }
        length
    }
}

/// Every name that the tree of a `use` brings in, with its path: `a::{b::C, D as E}` has `C` and `E`.
fn leaves_of(tree: &[&str], prefix: &[String], leaves: &mut Vec<(String, Vec<String>)>) {
    let mut path = prefix.to_vec();
    let mut at = 0;
    while at < tree.len() {
        match tree[at] {
            "{" => return branches(&tree[at + 1..]).for_each(|branch| leaves_of(branch, &path, leaves)),
            "as" => return leaves.extend(tree.get(at + 1).map(|name| ((*name).to_owned(), path))),
            // `a::{self}` is `a`.
            "self" if !path.is_empty() => {}
            word if is_word(word) => path.push(word.to_owned()),
            _ => {}
        }
        at += 1;
    }
    leaves.extend(path.last().cloned().map(|name| (name, path)));
}

/// What stands between the commas of a group, up to its closing brace.
fn branches<'t>(group: &'t [&'t str]) -> impl Iterator<Item = &'t [&'t str]> {
    let mut depth = 0;
    group.split(move |token| {
        depth += i32::from(*token == "{") - i32::from(*token == "}");
        depth < 0 || (depth == 0 && *token == ",")
    })
}

/// Words, `::`, and every other sign by itself.
fn tokens(code: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let length = match rest.find(|c: char| !is_of_word(c)) {
            _ if rest.starts_with("::") => 2,
            Some(0) => first.len_utf8(),
            Some(end) => end,
            None => rest.len(),
        };
        tokens.push(&rest[..length]);
        rest = rest[length..].trim_start();
    }
    tokens
}

fn is_of_word(character: char) -> bool {
    character.is_alphanumeric() || character == '_'
}

fn is_word(token: &str) -> bool {
    token.starts_with(is_of_word)
}

/// `A -> B` for every module `A` that uses a `B` which uses `A`, be it by way of others.
fn circles(uses: &Uses) -> Vec<String> {
    let reached: Uses = uses.keys().map(|module| (module.clone(), reached_from(module, uses))).collect();
    let pairs = uses.iter().flat_map(|(module, used)| used.iter().map(move |used| (module, used)));
    let tied =
        pairs.filter(|(module, used)| reached.get(*used).is_some_and(|reached| reached.contains(*module)));
    tied.map(|(module, used)| format!("{} -> {}", module.join("::"), used.join("::"))).collect()
}

/// What `module` uses, and what that uses, and so on.
fn reached_from(module: &ModulePath, uses: &Uses) -> BTreeSet<ModulePath> {
    let mut reached = BTreeSet::new();
    let mut open = vec![module];
    while let Some(used) = open.pop().and_then(|module| uses.get(module)) {
        open.extend(used.iter().filter(|used| reached.insert((*used).clone())));
    }
    reached
}

/// The module of a file in `src/`.
fn module_path(file: &Path) -> ModulePath {
    let mut path: ModulePath =
        file.with_extension("").iter().map(|name| name.to_str().unwrap().to_owned()).collect();
    if matches!(path.last().map(String::as_str), Some("mod" | "lib")) {
        path.pop();
    }
    path
}

fn path(text: &str) -> ModulePath {
    text.split("::").map(str::to_owned).collect()
}
