//! The commands below `brdfarm dataset` on a database.

use crate::folder::files_below;
use crate::place::Place;
use std::fs;

#[test]
fn commands_do_on_a_database_what_they_do_on_a_folder() {
    let place = Place::new(3);
    let store = place.database();
    let (coordinator, url) = place.coordinator(&store, "--blobs images");
    place.work(&url, "w");
    place.succeed("run --spec spec.toml --store undisturbed --backend native");
    let expected = place.manifest("undisturbed");

    // The coordinator goes on all the while.
    let said = place.succeed(&format!("dataset verify --store {store} --rerender 20%"));
    assert!(said.contains("verified 42 images of 3 materials"), "{said}");
    assert!(place.manifest(&store) == expected);
    let said = place.succeed(&format!("dataset diff undisturbed {store}"));
    assert!(said.contains("42 images in both"), "{said}");
    let said = place.succeed(&format!("dataset stats --store {store} --pixels"));
    assert!(said.contains("3 of 3 complete"), "{said}");
    place.succeed(&format!("dataset show --store {store} --out sheet.png"));
    place.succeed("dataset show --store undisturbed --out same.png");
    let read = |name: &str| fs::read(place.path().join(name)).expect("a file");
    assert!(read("sheet.png") == read("same.png"));

    faults_are_found_and_mended(&place, &store, &expected);
    what_nothing_names_goes(&place, &store);
    drop(coordinator);
    it_goes_out_and_into_another(&place, &store, &expected);
}

/// The digest of a view in a manifest.
fn digest_of(manifest: &[u8], material: u32, view: u32) -> String {
    let text = String::from_utf8_lossy(manifest);
    let mut rows = text.lines().map(|row| row.split(',').collect::<Vec<_>>());
    let header = rows.next().expect("a header");
    let [material_at, view_at, digest_at] = ["material", "view", "digest"].map(|name| {
        header
            .iter()
            .position(|column| *column == name)
            .expect(name)
    });
    let row = rows
        .find(|row| row[material_at] == material.to_string() && row[view_at] == view.to_string());
    row.expect("the view's row")[digest_at].to_owned()
}

/// An image hurt, one gone, and a record that lies about a third.
fn faults_are_found_and_mended(place: &Place, store: &str, expected: &[u8]) {
    let mut blobs = files_below(&place.path().join("images/blobs"));
    assert_eq!(blobs.len(), 42);
    // The third is another than the first two.
    let lied_about = digest_of(expected, 1, 3);
    blobs.retain(|blob| !blob.to_string_lossy().contains(&lied_about));
    assert_eq!(blobs.len(), 41);
    let before = fs::read(&blobs[7]).expect("an image");
    let mut hurt = before.clone();
    hurt[600] ^= 1;
    fs::write(&blobs[7], hurt).expect("written");
    fs::remove_file(&blobs[9]).expect("removed");
    place.sql(
        store,
        "UPDATE completions SET completion = jsonb_set(completion::jsonb, \
         '{views,3,statistics,max}', '0')::text WHERE material = 1",
    );
    let said = place.refuse(
        &format!("dataset verify --store {store} --rerender 100%"),
        1,
    );
    let name = blobs[7].file_name().expect("a name").to_string_lossy();
    assert!(said.contains(&*name), "{said}");
    assert!(said.contains("3 faults; 39 of 42 images sound"), "{said}");
    let said = place.succeed(&format!("dataset repair --store {store} --rerender 100%"));
    assert!(said.contains("mended 3 faults"), "{said}");
    assert!(said.contains("material 1, view 3") && said.contains("its record corrected"));
    assert!(fs::read(&blobs[7]).expect("an image") == before);
    assert!(place.manifest(store) == expected);
    place.succeed(&format!("dataset verify --store {store} --rerender 100%"));
    let completed = "SELECT sum(completed)::bigint FROM tallies";
    assert_eq!(place.number(store, completed), 3);
}

/// But only while nobody can be about to name it.
fn what_nothing_names_goes(place: &Place, store: &str) {
    let folder = place.path().join("images/blobs/00");
    fs::create_dir_all(&folder).expect("a folder");
    fs::write(folder.join(format!("{:064x}.exr", 7)), b"x").expect("written");
    fs::write(place.path().join("images/blobs/notes.txt"), b"x").expect("written");
    let said = place.succeed(&format!("dataset gc --store {store}"));
    assert!(said.contains("--delete would remove 1 image"), "{said}");
    place.sql(
        store,
        "INSERT INTO leases VALUES (0, 't', 'w', 'w', 0, now_ms() + 3600000, 0, 0)",
    );
    let gc = format!("dataset gc --store {store} --delete");
    let said = place.refuse(&gc, 1);
    assert!(said.contains("1 of the materials"), "{said}");
    assert!(said.contains("are with workers") && said.contains("`brdfarm pause`"));
    place.sql(store, "DELETE FROM leases");
    let said = place.succeed(&gc);
    assert!(said.contains("removed 1 image"), "{said}");
    assert_eq!(
        files_below(&place.path().join("images/blobs")).len(),
        42 + 1
    );
}

fn it_goes_out_and_into_another(place: &Place, store: &str, expected: &[u8]) {
    place.succeed(&format!(
        "dataset export shards --store {store} --layout webdataset"
    ));
    let other = place.database();
    let said = place.refuse(&format!("dataset import shards --store {other}"), 2);
    assert!(
        said.contains("say where its images are to be, by --blobs"),
        "{said}"
    );
    let import = format!("dataset import shards --store {other} --blobs other");
    let said = place.succeed(&import);
    assert!(said.contains("42 images of 3 materials imported"), "{said}");
    assert!(place.manifest(&other) == expected);
    place.succeed(&format!("dataset verify --store {other}"));
    let said = place.succeed(&import);
    assert!(said.contains("3 materials there before"), "{said}");
    // A coordinator of the other has nothing to do.
    let (_coordinator, url) = place.coordinator(&other, "");
    let status = place.succeed(&format!("status --json --coordinator {url}"));
    let status: serde_json::Value = serde_json::from_str(&status).expect("JSON");
    assert_eq!(
        (&status["completed"], &status["finished"]),
        (&3.into(), &true.into())
    );
}

#[test]
fn one_command_renders_a_set_into_a_database() {
    let place = Place::new(2);
    let store = place.database();
    let run = format!("run --spec spec.toml --store {store} --blobs images --backend native");
    let said = place.succeed(&run);
    assert!(said.contains("verified 28 images"), "{said}");
    assert!(place.path().join("manifest.parquet").exists());
    assert!(place.path().join("contact-sheet.png").exists());
    let said = place.succeed(&run);
    assert!(said.contains("nothing to do"), "{said}");
}

#[test]
fn a_database_that_is_no_store_is_told_from_one_that_is_away_and_stays_as_it_is() {
    let place = Place::new(2);
    let store = place.database();
    for command in ["verify", "stats", "repair", "gc --delete"] {
        let said = place.refuse(&format!("dataset {command} --store {store}"), 2);
        assert!(said.contains("there is no store in postgres://"), "{said}");
    }
    let tables = "SELECT count(*) FROM pg_tables WHERE schemaname = current_schema()";
    assert_eq!(place.number(&store, tables), 0, "nothing was made");

    let missing = store.replace("/postgres?", "/nowhere?");
    assert_ne!(missing, store, "the test's own server names its database");
    let said = place.refuse(&format!("dataset stats --store {missing}"), 2);
    assert!(said.contains("there is no database"), "{said}");
    let away = "postgres://brdfarm@/postgres?host=/nowhere";
    let said = place.refuse(&format!("dataset stats --store {away}"), 1);
    assert!(said.contains("cannot be reached"), "{said}");

    place.succeed(&format!(
        "run --spec spec.toml --store {store} --blobs images --backend native"
    ));
    let said = place.refuse(
        &format!("run --spec spec.toml --store {store} --blobs b"),
        2,
    );
    assert!(said.contains("are in"), "{said}");
    place.sql(&store, "UPDATE farm SET renderer_version = 'other'");
    for command in ["stats", "repair"] {
        let said = place.refuse(&format!("dataset {command} --store {store}"), 1);
        assert!(
            said.contains("was made with renderer version other"),
            "{said}"
        );
    }
    place.sql(&store, "DELETE FROM migrations");
    let said = place.refuse(&format!("dataset stats --store {store}"), 1);
    assert!(said.contains("tables of an older brdfarm"), "{said}");
    place.sql(&store, "INSERT INTO migrations VALUES (1000)");
    let said = place.refuse(&format!("dataset stats --store {store}"), 1);
    assert!(said.contains("install the brdfarm that made it"), "{said}");
}
