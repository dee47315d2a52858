//! Croissant 1.1 metadata, JSON-LD: the manifest as a set of records, the files as distribution.

use super::{CITATION, Described, FileDigest, sha256, summary};
use crate::layout::unit::Layout;
use dataset::{
    RENDERER_VERSION,
    manifest::{Column, Kind, columns},
    specification::Pixel,
};
use serde_json::{Map, Value, json};

/// The record sets of labels and of pixels, and the file that the labels are read from.
const RECORDS: &str = "images";
const PIXELS: &str = "pixels";
const MANIFEST: &str = "manifest.parquet";

/// The whole document.
pub(super) fn metadata(described: &Described<'_>, manifest: &FileDigest) -> Value {
    let specification = described.store.specification();
    let publication = described.publication;
    let mut document = json!({
        "@context": context(),
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": specification.name,
        "description": summary(described),
        "license": publication.licence.metadata(),
        "version": format!("{}.0.0", RENDERER_VERSION),
        "identifier": described.store.specification_hash().to_string(),
        "citeAs": CITATION,
        "isLiveDataset": false,
        "distribution": distribution(described, manifest),
        "recordSet": [{
            "@type": "cr:RecordSet",
            "@id": RECORDS,
            "name": RECORDS,
            "description": "One record an image.",
            "key": [{"@id": "images/material"}, {"@id": "images/view"}],
            "field": columns().iter().map(field).collect::<Vec<Value>>(),
        }, pixels(described)],
    });
    if let Value::Object(document) = &mut document {
        let mut add = |key: &str, value: &Option<String>| {
            if let Some(value) = value {
                document.insert(key.to_owned(), json!(value));
            }
        };
        add("url", &publication.url);
        add("datePublished", &publication.date);
        if let Some(creator) = &publication.creator {
            let creator = json!({"@type": "sc:Organization", "name": creator});
            document.insert("creator".to_owned(), creator);
        }
    }
    document
}

fn distribution(described: &Described<'_>, manifest: &FileDigest) -> Vec<Value> {
    let (pattern, encoding, what) = match described.layout {
        Layout::Files { .. } => ("*/*/*.exr", "image/x-exr", "The images."),
        Layout::WebDataset => ("*/*.tar", "application/x-tar", "The images in tar shards."),
        Layout::HuggingFace => (
            "*/*.parquet",
            "application/x-parquet",
            "Labels and images in Parquet shards.",
        ),
    };
    let mut distribution = vec![
        json!({
            "@type": "cr:FileObject",
            "@id": MANIFEST,
            "name": MANIFEST,
            "description": "One row an image.",
            "contentUrl": MANIFEST,
            "contentSize": format!("{} B", manifest.bytes),
            "encodingFormat": "application/x-parquet",
            "sha256": manifest.sha256,
        }),
        json!({
            "@type": "cr:FileSet",
            "@id": "image-files",
            "name": "image-files",
            "description": what,
            "encodingFormat": encoding,
            "includes": pattern,
        }),
    ];
    distribution.extend(mesh(described));
    distribution
}

/// The file of the sample's mesh, where that is one. OBJ and PLY have no media type in common.
fn mesh(described: &Described<'_>) -> Option<Value> {
    let mesh = described.store.specification().sample.mesh.as_ref()?;
    let (name, bytes) = (mesh.file_name(), mesh.loaded()?.bytes());
    Some(json!({
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "description": "The mesh of the sample, an OBJ or a PLY file.",
        "contentUrl": name,
        "contentSize": format!("{} B", bytes.len()),
        "encodingFormat": "application/octet-stream",
        "sha256": sha256(bytes),
    }))
}

/// What the pixels are: a record an image file, or a row of a shard that holds one.
fn pixels(described: &Described<'_>) -> Value {
    let image = &described.store.specification().image;
    let (kind, bits) = match image.pixel {
        Pixel::Half => ("cr:Float16", 16),
        Pixel::Float => ("cr:Float32", 32),
    };
    let (extract, what) = match described.layout {
        Layout::Files { .. } => (
            json!({"fileProperty": "content"}),
            "`path` of the manifest names it",
        ),
        Layout::WebDataset => (
            json!({"fileProperty": "content"}),
            "members of the shards that end in .exr; `path` of the manifest names the shard",
        ),
        Layout::HuggingFace => (json!({"column": "exr"}), "the column `exr` holds the file"),
    };
    json!({
        "@type": "cr:RecordSet",
        "@id": PIXELS,
        "name": PIXELS,
        "description": format!(
            "The images: OpenEXR with channels R, G and B of {bits}-bit floats; {what}."
        ),
        "field": [{
            "@type": "cr:Field",
            "@id": format!("{PIXELS}/exr"),
            "name": "exr",
            "description": format!(
                "An OpenEXR file. Decoded: height x width x 3 floats of {bits} bits, linear Rec.709 in \
                 units of white (the radiance of a perfect white diffuser that faces the bulb), row 0 \
                 the top of the film."
            ),
            "dataType": ["sc:ImageObject", kind],
            "isArray": true,
            "arrayShape": format!("{},{},3", image.height, image.width),
            "source": {
                "fileSet": {"@id": "image-files"},
                "extract": extract,
            },
        }],
    })
}

fn field(column: &Column) -> Value {
    let unit = match column.unit {
        "" | "1" => String::new(),
        unit => format!(" Unit: {unit}."),
    };
    let mut field = json!({
        "@type": "cr:Field",
        "@id": format!("{RECORDS}/{}", column.name),
        "name": column.name,
        "description": format!("{}{unit}", column.description),
        "dataType": data_type(column.kind),
        "source": {
            "fileObject": {"@id": MANIFEST},
            "extract": {"column": column.name},
        },
    });
    if let (Kind::F64List(length), Value::Object(field)) = (column.kind, &mut field) {
        field.insert("isArray".to_owned(), json!(true));
        field.insert("arrayShape".to_owned(), json!(length.to_string()));
    }
    field
}

fn data_type(kind: Kind) -> &'static str {
    match kind {
        Kind::Text => "sc:Text",
        Kind::U32 => "cr:UInt32",
        Kind::U64 => "cr:UInt64",
        Kind::F64 | Kind::F64List(_) => "cr:Float64",
        Kind::Bool => "sc:Boolean",
    }
}

/// The context that the specification prescribes.
fn context() -> Value {
    let mut context = json!({
        "@language": "en",
        "@vocab": "https://schema.org/",
        "cr": "http://mlcommons.org/croissant/",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "dct": "http://purl.org/dc/terms/",
        "sc": "https://schema.org/",
        "conformsTo": "dct:conformsTo",
        "data": {"@id": "cr:data", "@type": "@json"},
        "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
        "description": {"@container": "@language"},
        "examples": {"@id": "cr:examples", "@type": "@json"},
        "name": {"@container": "@language"},
    });
    const TERMS: [&str; 29] = [
        "arrayShape",
        "citeAs",
        "column",
        "containedIn",
        "equivalentProperty",
        "extract",
        "field",
        "fileObject",
        "fileProperty",
        "fileSet",
        "format",
        "includes",
        "isArray",
        "isLiveDataset",
        "jsonPath",
        "key",
        "md5",
        "parentField",
        "path",
        "recordSet",
        "references",
        "regex",
        "repeated",
        "replace",
        "samplingRate",
        "separator",
        "source",
        "subField",
        "transform",
    ];
    if let Value::Object(context) = &mut context {
        let terms: Map<String, Value> = TERMS
            .iter()
            .map(|term| ((*term).to_owned(), json!(format!("cr:{term}"))))
            .collect();
        context.extend(terms);
    }
    context
}
