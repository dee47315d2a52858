//! `brdfarm dataset observability`: its table as pyarrow reads it; killed, it goes on and ends the
//! same; what is wrong is told in one sentence.

use crate::pairs::{TRAIN, exported, fail};
use crate::readers::python;
use crate::workplace::Workplace;
use std::fs;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Three views, two of them without the chart, which cost little.
const SPECIFICATION: &str = r#"
name = "observed"
materials = 4
[image]
width = 8
height = 8
[accuracy]
relative = 1e-2
absolute = 1e-3
[[views]]
camera_elevation_deg = 90.0
light_elevation_deg = 45.0
rotation_deg = 0.0
checker = true
[[views]]
camera_elevation_deg = 30.0
light_elevation_deg = 90.0
rotation_deg = 0.0
checker = false
[[views]]
camera_elevation_deg = 45.0
light_elevation_deg = 45.0
rotation_deg = 30.0
checker = false
"#;

/// The command, short of where to write.
const OBSERVE: &str =
    "dataset observability --side 8 --sets 0,1 --sets 2,0-1 --noise-sd 0.01 --out";

/// Parts that are waited for before a kill.
const KILLS: [usize; 3] = [0, 1, 2];

/// A folder with a store.
fn store() -> Workplace {
    let place = Workplace::empty();
    fs::write(place.path().join("spec.toml"), SPECIFICATION).unwrap();
    place.succeed("run --spec spec.toml");
    place
}

fn parts(folder: &Path) -> usize {
    let Ok(entries) = fs::read_dir(folder) else {
        return 0;
    };
    let names = entries.map(|entry| entry.unwrap().path());
    names
        .filter(|path| path.extension().is_some_and(|ending| ending == "part"))
        .count()
}

fn table(place: &Workplace, name: &str) -> Vec<u8> {
    fs::read(place.path().join(name)).unwrap()
}

#[track_caller]
fn assert_says(said: &str, words: &[&str]) {
    for word in words {
        assert!(said.contains(word), "{said:?} does not say {word:?}");
    }
}

#[test]
fn a_table_reads_with_pyarrow_and_is_the_same_on_any_threads_and_after_kills() {
    let place = store();
    let said = place.succeed(&format!("{OBSERVE} one.parquet --threads 1"));
    assert_eq!(said, "one.parquet: 20 rows\n");
    let said = python(
        &place,
        "tests/clients/read_observability.py",
        &["one.parquet"],
    );
    assert!(said.contains("20 rows of 4 materials"), "{said}");
    let expected = table(&place, "one.parquet");
    place.succeed(&format!("{OBSERVE} two.parquet --threads 2"));
    assert!(
        table(&place, "two.parquet") == expected,
        "two threads differ from one"
    );

    let command = format!("{OBSERVE} killed.parquet --threads 1");
    let folder = place.path().join("killed.parquet.parts");
    for wanted in KILLS {
        let mut child = place.spawn(&command);
        let deadline = Instant::now() + Duration::from_secs(60);
        while !folder.exists() || parts(&folder) < wanted {
            assert!(Instant::now() < deadline, "no {wanted} parts");
            sleep(Duration::from_millis(2));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!place.path().join("killed.parquet").exists());
    }
    let said = fail(&place, &format!("{command} --materials 0-2"), 2);
    assert_says(
        &said,
        &["killed.parquet.parts holds", "materials", "0-2", "0-3"],
    );
    // A damaged part is computed again.
    let first = folder.join("000000.part");
    let mut bytes = fs::read(&first).unwrap();
    bytes[100] ^= 1;
    fs::write(&first, bytes).unwrap();
    place.succeed(&command);
    assert!(
        table(&place, "killed.parquet") == expected,
        "a killed table differs"
    );
    assert!(!folder.exists(), "the parts are left");

    // A table that is whole is not computed again, and what a kill left of its folder goes.
    fs::create_dir(&folder).unwrap();
    place.succeed(&command);
    assert!(table(&place, "killed.parquet") == expected);
    assert!(!folder.exists(), "the folder is left");
}

#[test]
fn what_is_wrong_is_told_in_one_sentence() {
    let place = store();
    let refuse = |arguments: &str| {
        fail(
            &place,
            &format!("dataset observability --out a.parquet {arguments}"),
            2,
        )
    };
    assert_says(&refuse("--sets 0,3"), &["no view 3", "there are 3"]);
    assert_says(&refuse("--views 0,1 --sets 0,2"), &["--sets 0,2", "view 2"]);
    assert_says(&refuse("--sets 1,1"), &["--sets 1,1", "at least two views"]);
    assert_says(&refuse("--sets 0,1 --sets 1,0"), &["--sets 1,0", "twice"]);
    assert_says(&refuse("--materials 4"), &["no material 4"]);
    assert_says(&refuse("--store nowhere"), &["nowhere"]);
    let said = fail(&place, "dataset observability --out a.csv", 2);
    assert_says(&said, &["a.csv", ".parquet"]);
    for option in ["--noise-sd 0", "--noise-sd nan", "--side 0", "--sets a"] {
        let output = place.run(&format!("dataset observability --out a.parquet {option}"));
        assert_eq!(output.status.code(), Some(2), "{option}");
    }
    assert!(!place.path().join("a.parquet.parts").exists());

    let options = |side: u32| format!("--materials 0 --views 1,2 --side {side}");
    fs::create_dir(place.path().join("a.parquet.parts")).unwrap();
    let plan = place.path().join("a.parquet.parts/plan.json");
    fs::write(&plan, "{}").unwrap();
    assert_says(&refuse(&options(8)), &["a.parquet.parts", "another table"]);
    fs::remove_file(&plan).unwrap();
    place.succeed(&format!(
        "dataset observability --out a.parquet {}",
        options(8)
    ));
    let said = refuse(&options(7));
    assert_says(
        &said,
        &["a.parquet holds another table", "film", "[8,8]", "[7,7]"],
    );
    fs::write(place.path().join("a.parquet"), "PAR1").unwrap();
    assert_says(&refuse(&options(8)), &["something else", "--out"]);
}

#[test]
fn losses_count_as_much_as_photographs_show() {
    let place = exported();
    let table = "dataset observability --store store --side 8 --sets 0,1 --out";
    place.succeed(&format!("{table} shown.parquet"));
    let train = format!("{TRAIN} --variant cnn0 --out");
    place.succeed(&format!("{train} paper"));
    place.succeed(&format!(
        "{train} shown --weights observable --observability shown.parquet"
    ));
    let log = |out: &str| fs::read(place.path().join(out).join("log.csv")).unwrap();
    assert!(log("paper") != log("shown"), "weights change nothing");
    let judged = place.succeed(
        "evaluate shown/model.safetensors --data pairs --out judged --observability shown.parquet",
    );
    assert!(judged.contains("shown"), "{judged}");
    let parameters = fs::read_to_string(place.path().join("judged/parameters.csv")).unwrap();
    assert!(
        parameters.lines().next().unwrap().ends_with(",bound_ior"),
        "{parameters}"
    );
    let page = || fs::read_to_string(place.path().join("judged/report.html")).unwrap();
    for words in [
        "ior: least standard deviation",
        "<td>observable</td>",
        "noise of 2.0 steps of an 8-bit srgb code",
    ] {
        assert!(page().contains(words), "{words}");
    }
    let noisy = "evaluate shown --data pairs --out judged --observability shown.parquet --noise";
    place.succeed(&format!("{noisy} 6"));
    assert!(page().contains("noise of 6.0 steps of an 8-bit log code"));
    // No noise leaves the table's bounds, and the least that a number can tell breaks nothing.
    place.succeed(&format!("{noisy} 0"));
    assert!(page().contains("noise of 2.0 steps of an 8-bit srgb code"));
    place.succeed(&format!("{noisy} 1e-45"));

    let observable = |rest: &str| format!("{train} a --weights observable --observability {rest}");
    place.succeed(&format!("{table} some.parquet --materials 0-3"));
    let said = fail(&place, &observable("some.parquet"), 2);
    assert_says(&said, &["lacks material"]);
    place.succeed("dataset observability --store store --side 8 --views 0 --out one.parquet");
    let said = fail(&place, &observable("one.parquet"), 2);
    assert_says(&said, &["one.parquet", "no rows of the views [0, 1]"]);
    let said = fail(&place, &observable("store/manifest.parquet"), 2);
    assert_says(&said, &["manifest.parquet", "no table of observability"]);
    let output = place.run(&format!("{train} a --weights observable"));
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_training_can_learn_not_to_change_photographs() {
    let place = exported();
    place.succeed("dataset observability --store store --side 8 --sets 0,1 --out shown.parquet");
    let metric = "--metric 0.5 --observability shown.parquet";
    let train = |out: &str, rest: &str| format!("{TRAIN} --variant nested {rest} --out {out}");
    place.succeed(&train("plain", ""));
    place.succeed(&train("taught", metric));
    place.succeed(&train("again", &format!("{metric} --threads 1")));
    let file = |out: &str, name: &str| fs::read(place.path().join(out).join(name)).unwrap();
    for name in ["log.csv", "model.safetensors"] {
        assert!(file("taught", name) == file("again", name), "{name}");
        assert!(file("taught", name) != file("plain", name), "{name}");
    }
    place.succeed("evaluate plain taught --data pairs --out judged");
    let page = fs::read_to_string(place.path().join("judged/report.html")).unwrap();
    assert!(page.contains("<td>0.5</td>"), "{page}");

    let said = fail(&place, &train("plain", metric), 2);
    assert_says(&said, &["plain", "metric"]);
    for share in ["0", "-1", "nan", "1001"] {
        let rest = format!("--metric={share} --observability shown.parquet");
        let output = place.run(&train("a", &rest));
        assert_eq!(output.status.code(), Some(2), "{share}");
    }
    let output = place.run(&train("a", "--metric 1"));
    assert_eq!(output.status.code(), Some(2));
}
