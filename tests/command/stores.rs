//! The command on a store that is there, and answers to what people mistype.

use crate::{brdfarm, text};
use serde_json::Value;
use std::{fs, path::Path};

/// Runs commands in a folder. Returns what each said on standard output and on standard error; its
/// exit code has to be `code`.
#[track_caller]
fn run(folder: &Path, arguments: &str, code: i32) -> (String, String) {
    let words: Vec<&str> = arguments.split(' ').collect();
    let output = brdfarm(&words, folder);
    let said = text(&output.stderr).to_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments}: {said}");
    (text(&output.stdout).to_owned(), said)
}

#[test]
fn a_store_goes_on_with_its_own_specification() {
    let folder = tempfile::tempdir().expect("a directory");
    let folder = folder.path();
    for (name, width) in [("own", 8), ("other", 9)] {
        let specification = format!("materials = 2\n[image]\nwidth = {width}\nheight = 8\n");
        fs::write(folder.join(format!("{name}.toml")), specification).expect("written");
    }
    let run = |arguments: &str, code: i32| {
        let (told, said) = run(folder, arguments, code);
        said + &told
    };
    let said = run("run --spec own.toml --backend native", 0);
    let planned = "to render: 2 materials, 28 images of 8 x 8, about 0 MB";
    assert!(said.starts_with(planned), "{said}");
    let said = run("run --backend native", 0);
    assert!(
        said.starts_with("nothing to do: 28 images of 2 materials"),
        "{said}"
    );
    let said = run("run --backend native --materials 3", 0);
    assert!(said.contains("rendered 14 images"), "{said}");
    let said = run(
        "coordinator serve --listen 127.0.0.1:0 --exit-when-complete",
        0,
    );
    assert!(said.contains("3 of 3 materials complete"), "{said}");
    let said = run("dataset specification --store store", 0);
    assert!(
        said.contains("materials = 3") && said.contains("width = 8"),
        "{said}"
    );

    let said = run("run --spec other.toml", 2);
    assert!(
        said.contains("image.width: 8 in the store, 9 given"),
        "{said}"
    );
    let said = run("dataset specification --store nowhere", 2);
    assert!(said.contains("there is no store"), "{said}");
}

#[test]
fn what_people_type_is_understood_or_answered() {
    let folder = tempfile::tempdir().expect("a directory");
    let folder = folder.path();
    fs::write(
        folder.join("set.toml"),
        "materials = 2\n[image]\nwidth = 8\nheight = 8\n",
    )
    .expect("written");
    let run = |arguments: &str, code: i32| run(folder, arguments, code);
    let (told, _) = run("run --spec set.toml --backend native", 0);
    assert!(told.contains("rendered 28 images"), "{told}");

    let (rows, said) = run("dataset manifest export --format jsonl --out -", 0);
    assert_eq!((rows.lines().count(), said.as_str()), (28, ""));
    assert!(!folder.join("-").exists());
    // A row is a material, and a store has a specification.
    let row: Value = serde_json::from_str(rows.lines().nth(19).expect("a row")).expect("JSON");
    fs::write(folder.join("row.json"), row.to_string()).expect("written");
    let (digest, said) = run(
        "render --store store --material 1 --view 5 --out own.exr",
        0,
    );
    assert_eq!(said, "");
    assert_eq!(row["digest"].as_str(), digest.split(' ').next());
    run(
        "render --store store --material-file row.json --view 5 --out row.exr",
        0,
    );
    let (_, said) = run("render --store store --material 2 --view 5 --out a.exr", 0);
    assert_eq!(
        said,
        "note: material 2 is beyond the 2 materials of this set\n"
    );

    let (_, said) = run("dataset verify --rerender 5", 2);
    assert!(said.contains("write 5%"), "{said}");
    for materials in ["--materials -4", "--materials=0", "--materials 1000001"] {
        let (_, said) = run(&format!("run {materials}"), 2);
        assert!(said.contains("a set has 1 to 1000000 materials"), "{said}");
    }
    let (told, _) = run("status --store store", 0);
    assert!(
        told.contains("(complete)\nmaterials   2 of 2 complete"),
        "{told}"
    );

    // An unfinished one, and who goes on with it.
    let specification = fs::read_to_string(folder.join("store/specification.json"));
    let larger = specification
        .expect("a file")
        .replace("\"materials\":2", "\"materials\":90");
    fs::write(folder.join("store/specification.json"), larger).expect("written");
    let (told, _) = run("dataset verify", 1);
    assert!(
        told.contains("materials 2 to 89: 88 of them are not complete"),
        "{told}"
    );
    let (told, _) = run("status --store store --json", 0);
    let told: Value = serde_json::from_str(&told).expect("JSON");
    assert_eq!(
        (&told["mode"], &told["completed"]),
        (&"not_served".into(), &2.into())
    );
}

/// Each message that operating.md quotes is one that the program has.
#[test]
fn quoted_messages_exist() {
    fn sources(folder: &Path, all: &mut String) {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if path.is_dir() {
                let is_code = !name.starts_with('.') && name != "target" && name != "tests";
                if is_code {
                    sources(&path, all);
                }
            } else if name.ends_with(".rs") {
                *all += &fs::read_to_string(&path).expect("text");
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut code = String::new();
    sources(root, &mut code);
    // A message that goes on in the next line has no line's end in it.
    let pieces: Vec<&str> = code.split("\\\n").map(str::trim_start).collect();
    let code = pieces.concat();
    let page = fs::read_to_string(root.join("docs/operating.md")).expect("a page");
    let (_, troubles) = page
        .split_once("## When something is wrong")
        .expect("it is there");
    let rows = troubles.lines().filter(|line| line.starts_with('|'));
    let quoted: Vec<&str> = rows
        .flat_map(|row| row.split('"').skip(1).step_by(2))
        .collect();
    assert!(quoted.len() > 5, "{quoted:?}");
    for message in quoted {
        assert!(code.contains(message), "nothing says {message:?}");
    }
}
