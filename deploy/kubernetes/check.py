#!/usr/bin/env python3
"""Checks that what rendered Kubernetes documents name exists, and that pods can read their secrets.

    check.py RENDERED.yaml [--same-as OTHER.yaml]    # ends with 1 and a line for each fault
    check.py RENDERED.yaml --query                   # prints the autoscaler's statement
    check.py RENDERED.yaml --core                    # prints the documents that are not KEDA's

With --same-as the two have to be equal but for the suffixes of generated names.
"""

import argparse
import json
import re
import sys
import urllib.parse

import yaml

# Where a mapping names another document: the key it stands under, its field, and the kind.
REFERENCES = {("configMapRef", "name"): "ConfigMap", ("configMapKeyRef", "name"): "ConfigMap",
              ("configMap", "name"): "ConfigMap", ("configMapTargetRef", "name"): "ConfigMap",
              ("secretRef", "name"): "Secret", ("secretKeyRef", "name"): "Secret",
              ("secret", "secretName"): "Secret", ("secretTargetRef", "name"): "Secret",
              ("authenticationRef", "name"): "TriggerAuthentication",
              ("scaleTargetRef", "name"): "Deployment"}


class Farm:
    """Rendered documents, by kind and name."""

    def __init__(self, documents):
        self.documents = [document for document in documents if document]
        self.named = {(document["kind"], document["metadata"]["name"]): document
                      for document in self.documents}

    def of_kind(self, *kinds):
        return [document for document in self.documents if document["kind"] in kinds]

    def pods(self):
        """Names and specifications of pods, with their labels."""
        for document in self.of_kind("Deployment", "Job"):
            template = document["spec"]["template"]
            name = f"{document['kind']} {document['metadata']['name']}"
            yield name, template["spec"], template["metadata"].get("labels", {})


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


def names_resolve(farm):
    """Documents and keys that others name exist."""
    for document in farm.documents:
        where = f"{document['kind']} {document['metadata']['name']}"
        for key, node in objects(document):
            for (above, field), kind in REFERENCES.items():
                if key != above or field not in node:
                    continue
                target = farm.named.get((kind, node[field]))
                if target is None:
                    yield f"{where}: there is no {kind} {node[field]}"
                    continue
                data = target.get("data", {})
                wanted = [item["key"] for item in node.get("items", [])]
                wanted += [node["key"]] if "key" in node else []
                for entry in wanted:
                    if entry not in data:
                        yield f"{where}: {kind} {node[field]} has no {entry}"


def selectors_select(farm):
    """Services, policies and budgets select some pod."""
    for document in farm.documents:
        for key, node in objects(document):
            labels = node.get("matchLabels")
            if document["kind"] == "Service" and key == "selector":
                labels = node
            if labels and key not in {"namespaceSelector"}:
                if not any(labels.items() <= pod.items() for _, _, pod in farm.pods()):
                    yield f"{document['kind']} {document['metadata']['name']}: {labels} selects no pod"


def environment(farm, container):
    """The variables of a container that documents here give it; values where they are known."""
    found = {}
    for source in container.get("envFrom", []):
        for key, kind in [("configMapRef", "ConfigMap"), ("secretRef", "Secret")]:
            if key in source:
                found.update(farm.named.get((kind, source[key]["name"]), {}).get("data", {}))
    found.update((variable["name"], variable.get("value")) for variable in container.get("env", []))
    return found


def containers_get_what_they_read(farm):
    """Volumes exist, files of arguments are mounted, variables are given."""
    for where, pod, _ in farm.pods():
        volumes = {volume["name"] for volume in pod.get("volumes", [])}
        for container in pod["containers"]:
            mounts = {mount["mountPath"]: mount for mount in container.get("volumeMounts", [])}
            for mount in mounts.values():
                if mount["name"] not in volumes:
                    yield f"{where}: there is no volume {mount['name']}"
            given = environment(farm, container)
            words = container.get("args", []) + container.get("command", [])
            for key, node in objects(container):
                words = words + (node.get("command", []) if key == "exec" else [])
            for word in words:
                for variable in re.findall(r"\$\((\w+)\)", word):
                    if variable not in given:
                        yield f"{where}: nothing gives {variable}, which {word} wants"
                path = word.partition("=")[2]
                if path.startswith("/") and not any(
                        path == mount or path.startswith(f"{mount}/") for mount in mounts):
                    yield f"{where}: {word} is not mounted"


def secrets_are_private_and_readable(farm):
    """A pod's user reads its secret files, by its group, and nobody else does."""
    for where, pod, _ in farm.pods():
        context = pod.get("securityContext", {})
        for volume in pod.get("volumes", []):
            if "secret" not in volume:
                continue
            mode = volume["secret"].get("defaultMode", 0o644)
            if mode & 0o007:
                yield f"{where}: everybody reads {volume['name']}, mode {mode:04o}"
            if context.get("runAsUser", 0) != 0 and not (mode & 0o040 and "fsGroup" in context):
                yield f"{where}: user {context['runAsUser']} cannot read {volume['name']}, mode {mode:04o}"
    for document in farm.of_kind("ConfigMap"):
        for key, text in document.get("data", {}).items():
            if re.search(r"BEGIN [A-Z ]*PRIVATE KEY|^[0-9a-f]{64}$|password\s*=|://[^/@\s]+:[^/@\s]+@", text, re.I):
                yield f"ConfigMap {document['metadata']['name']}: {key} looks like a secret"


def autoscaler_rules(farm):
    """What KEDA scales has no replicas of its own, and KEDA asks the coordinators' database."""
    for scaled in farm.of_kind("ScaledObject"):
        target = farm.named.get(("Deployment", scaled["spec"]["scaleTargetRef"]["name"]), {})
        if "replicas" in target.get("spec", {}):
            yield f"Deployment {target['metadata']['name']}: replicas undo what the autoscaler chose"
    for document in farm.of_kind("ConfigMap"):
        data = document.get("data", {})
        if "DATABASE" not in data:
            continue
        url = urllib.parse.urlsplit(data["DATABASE"])
        theirs = (url.hostname, str(url.port or 5432), url.path[1:])
        ours = tuple(data.get(key) for key in ("DATABASE_HOST", "DATABASE_PORT", "DATABASE_NAME"))
        if theirs != ours:
            yield f"ConfigMap {document['metadata']['name']}: coordinators use {theirs}, the autoscaler {ours}"


def services_exist(farm):
    """Hosts without a dot in URLs are services here, with that port."""
    for where, pod, _ in farm.pods():
        for container in pod["containers"]:
            for word in container.get("args", []):
                url = urllib.parse.urlsplit(word)
                if url.scheme not in {"http", "https"} or "." in (url.hostname or "."):
                    continue
                service = farm.named.get(("Service", url.hostname))
                ports = [port["port"] for port in service["spec"]["ports"]] if service else []
                if url.port not in ports:
                    yield f"{where}: there is no service {url.hostname} with port {url.port}"
    for service in farm.of_kind("Service"):
        wanted = service["spec"]["selector"]
        named = {port.get("name") for _, pod, labels in farm.pods() if wanted.items() <= labels.items()
                 for container in pod["containers"] for port in container.get("ports", [])}
        for port in service["spec"]["ports"]:
            if isinstance(port.get("targetPort"), str) and port["targetPort"] not in named:
                yield f"Service {service['metadata']['name']}: no pod has a port {port['targetPort']}"


WANTED = {"coordinator": {"certificate.pem", "key.pem", "tokens"}, "worker": {"authority.pem", "token"}}


def credentials_are_complete(farm):
    """What a role is pointed to by --credentials has the files that it wants."""
    for where, pod, _ in farm.pods():
        secrets = {volume["name"]: volume["secret"]["secretName"]
                   for volume in pod.get("volumes", []) if "secret" in volume}
        for container in pod["containers"]:
            words = container.get("args", [])
            mounts = {mount["mountPath"]: mount["name"] for mount in container.get("volumeMounts", [])}
            for word in words:
                if word.startswith("--credentials="):
                    secret = secrets.get(mounts.get(word.partition("=")[2]))
                    data = farm.named.get(("Secret", secret), {}).get("data", {})
                    for lacking in sorted(WANTED[words[0]] - data.keys()):
                        yield f"{where}: {word} has no {lacking}"


def mutual_tls_is_not_lost(farm):
    """Probes and workers here show no certificate, so a farm that asks for some cannot work."""
    for document in farm.of_kind("Secret"):
        if "client-authority.pem" in document.get("data", {}):
            yield f"Secret {document['metadata']['name']}: these files know no --mutual-tls"


CHECKS = [names_resolve, selectors_select, containers_get_what_they_read,
          secrets_are_private_and_readable, autoscaler_rules, services_exist, credentials_are_complete,
          mutual_tls_is_not_lost]


def without_suffixes(farm):
    """The documents as text, with generated names cut."""
    cut = {name: name.rpartition("-")[0] for kind, name in farm.named if kind in {"ConfigMap", "Secret"}}
    texts = {}
    for document in farm.documents:
        if document["kind"] == "Secret":
            # kubectl breaks long lines of base64.
            data = {key: "".join(text.split()) for key, text in document["data"].items()}
            document = document | {"data": data}
        text = json.dumps(document, sort_keys=True)
        for name, short in cut.items():
            text = text.replace(json.dumps(name), json.dumps(short))
        document = json.loads(text)
        texts[document["kind"], document["metadata"]["name"]] = text
    return texts


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rendered")
    parser.add_argument("--same-as")
    parser.add_argument("--query", action="store_true")
    parser.add_argument("--core", action="store_true")
    options = parser.parse_args()
    with open(options.rendered) as file:
        farm = Farm(yaml.safe_load_all(file))
    if options.query:
        (scaled,) = farm.of_kind("ScaledObject")
        print(scaled["spec"]["triggers"][0]["metadata"]["query"])
        return 0
    if options.core:
        core = [document for document in farm.documents if "keda.sh/" not in document["apiVersion"]]
        yaml.safe_dump_all(core, sys.stdout)
        return 0
    faults = [fault for check in CHECKS for fault in check(farm)]
    if options.same_as:
        with open(options.same_as) as file:
            other = Farm(yaml.safe_load_all(file))
        ours, theirs = without_suffixes(farm), without_suffixes(other)
        faults += [f"{kind} {name}: the two renderings differ" for kind, name in ours.keys() | theirs.keys()
                   if ours.get((kind, name)) != theirs.get((kind, name))]
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
