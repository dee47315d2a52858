#!/usr/bin/env python3
"""Renders a kustomization as far as this folder uses kustomize, for machines without kubectl.

    render.py FOLDER > rendered.yaml

Knows resources, namespace, configMapGenerator, secretGenerator, configurations (nameReference),
labels (pairs, on selectors and templates too) and images, and refuses every other key. The suffixes
of generated names are its own, not kustomize's; otherwise it writes what `kubectl kustomize` writes.
"""

import base64
import hashlib
import json
import pathlib
import sys

import yaml

KNOWN = {"apiVersion", "kind", "namespace", "resources", "configMapGenerator", "secretGenerator",
         "configurations", "labels", "images"}

# Where core kinds name config maps and secrets: the key above a name, and the name's own key.
REFERENCES = {"ConfigMap": [("configMapRef", "name"), ("configMapKeyRef", "name"), ("configMap", "name")],
              "Secret": [("secretRef", "name"), ("secretKeyRef", "name"), ("secret", "secretName")]}


def objects(node):
    """Every mapping inside a document with the key that it stands under."""
    waiting = [("", node)]
    while waiting:
        key, node = waiting.pop()
        if isinstance(node, dict):
            yield key, node
            waiting.extend(node.items())
        elif isinstance(node, list):
            waiting.extend((key, item) for item in node)


def at_path(node, path):
    """The mappings that hold the last key of a path like spec/triggers/authenticationRef/name."""
    if isinstance(node, list):
        for item in node:
            yield from at_path(item, path)
    elif isinstance(node, dict):
        if len(path) == 1 and path[0] in node:
            yield node
        elif len(path) > 1 and path[0] in node:
            yield from at_path(node[path[0]], path[1:])


def read_env(path):
    lines = (line.strip() for line in path.read_text().splitlines())
    return dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))


def generated(folder, generator, kind):
    """A config map or a secret of a generator, and its name without the suffix."""
    data = dict(literal.split("=", 1) for literal in generator.get("literals", []))
    for name in generator.get("envs", []):
        data.update(read_env(folder / name))
    for name in generator.get("files", []):
        key, _, path = name.rpartition("=")
        path = folder / (path or name)
        data[key or path.name] = path.read_text()
    digest = hashlib.sha256(json.dumps([kind, data], sort_keys=True).encode()).hexdigest()
    document = {"apiVersion": "v1", "kind": kind,
                "metadata": {"name": f"{generator['name']}-{digest[:10]}"}}
    if kind == "Secret":
        document["type"] = "Opaque"
        data = {key: base64.b64encode(text.encode()).decode() for key, text in data.items()}
    document["data"] = data
    return generator["name"], document


def rename(documents, renamed, configurations):
    """Gives references the names that generated things have."""
    for document in documents:
        for key, node in objects(document):
            for kind, places in REFERENCES.items():
                for above, name in places:
                    if key == above and (kind, node.get(name)) in renamed:
                        node[name] = renamed[kind, node[name]]
        for configuration in configurations:
            for reference in configuration["nameReference"]:
                for field in reference["fieldSpecs"]:
                    if document["kind"] != field["kind"]:
                        continue
                    path = field["path"].split("/")
                    for holder in at_path(document, path):
                        old = (reference["kind"], holder[path[-1]])
                        holder[path[-1]] = renamed.get(old, holder[path[-1]])


def label(document, pairs):
    """Puts labels on a document, its selectors and its template."""
    document["metadata"].setdefault("labels", {}).update(pairs)
    for key, node in objects(document):
        if key == "template":
            node.setdefault("metadata", {}).setdefault("labels", {}).update(pairs)
        if "matchLabels" in node and key in {"selector", "podSelector", "labelSelector"}:
            node["matchLabels"].update(pairs)
        if document["kind"] == "Service" and key == "selector":
            node.update(pairs)


def change_image(document, image):
    for _, node in objects(document):
        named, _, tag = str(node.get("image", "")).partition(":")
        if named == image["name"]:
            node["image"] = f"{image.get('newName', named)}:{image.get('newTag', tag)}"


def render(folder):
    """The documents of a kustomization, and what renames in it."""
    folder = pathlib.Path(folder)
    kustomization = yaml.safe_load((folder / "kustomization.yaml").read_text())
    unknown = set(kustomization) - KNOWN
    if unknown:
        raise SystemExit(f"{folder}/kustomization.yaml: this renderer does not know {sorted(unknown)}")
    documents, renamed, configurations = [], {}, []
    for name in kustomization.get("resources", []):
        if (folder / name).is_dir():
            more, names, configured = render(folder / name)
            documents += more
            renamed.update(names)
            configurations += configured
        else:
            documents += yaml.safe_load_all((folder / name).read_text())
    for name in kustomization.get("configurations", []):
        configurations.append(yaml.safe_load((folder / name).read_text()))
    for key, kind in [("configMapGenerator", "ConfigMap"), ("secretGenerator", "Secret")]:
        for generator in kustomization.get(key, []):
            name, document = generated(folder, generator, kind)
            renamed[kind, name] = document["metadata"]["name"]
            documents.append(document)
    rename(documents, renamed, configurations)
    for document in documents:
        for labels in kustomization.get("labels", []):
            label(document, labels["pairs"])
        for image in kustomization.get("images", []):
            change_image(document, image)
        if "namespace" in kustomization and document["kind"] != "Namespace":
            document["metadata"]["namespace"] = kustomization["namespace"]
    return documents, renamed, configurations


if __name__ == "__main__":
    yaml.safe_dump_all(render(sys.argv[1])[0], sys.stdout, sort_keys=True)
