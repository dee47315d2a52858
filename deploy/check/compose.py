#!/usr/bin/env python3
"""Checks that what compose.yaml names exists, and tells what its services read.

    compose.py compose.yaml            # ends with 1 and a line for each fault
    compose.py compose.yaml --mounts   # a line for each folder or file that a service of ours mounts
"""

import ipaddress
import re
import sys

import yaml


def faults(compose):
    services = compose["services"]
    for name, service in services.items():
        depends = service.get("depends_on", [])
        for other in depends:
            if other not in services:
                yield f"{name}: depends on {other}, which is no service"
        for secret in service.get("secrets", []):
            if secret not in compose.get("secrets", {}):
                yield f"{name}: there is no secret {secret}"
        mounted = [f"/run/secrets/{secret}" for secret in service.get("secrets", [])]
        for volume in service.get("volumes", []):
            source, target = volume.split(":")[:2]
            mounted.append(target)
            if not source.startswith(("./", "/")) and source not in compose.get("volumes", {}):
                yield f"{name}: there is no volume {source}"
        words = [str(word) for word in (service.get("command") or []) + (service.get("entrypoint") or [])]
        words += [f"{key}={value}" for key, value in service.get("environment", {}).items()]
        for word in words:
            yield from named_by(name, word, services)
            path = word.partition("=")[2]
            if path.startswith(("/run/", "/etc/")) and path not in mounted:
                yield f"{name}: nothing mounts {path}"
        for port in service.get("ports", []):
            address = str(port).rpartition(":")[0].rpartition(":")[0]
            if not address or not ipaddress.ip_address(address.strip("[]")).is_loopback:
                yield f"{name}: port {port} is open to other machines"
    if not any("7117" in str(port) for port in services.get("coordinator", {}).get("ports", [])):
        yield "coordinator: no port of this machine leads to it, so nobody can ask how far it is"


def named_by(name, word, services):
    """Hosts of URLs, and of --option=HOST:PORT, are services."""
    hosts = re.findall(r"\b(?:https?|postgres)://(?:[^@/]*@)?([a-z][a-z0-9-]*)", word)
    hosts += re.findall(r"-master=([a-z][a-z0-9-]*):", word)
    for host in hosts:
        if host not in services and host != "localhost":
            yield f"{name}: {word} names {host}, which is no service"


def main():
    with open(sys.argv[1]) as file:
        compose = yaml.safe_load(file)
    if sys.argv[2:] == ["--mounts"]:
        for name, service in compose["services"].items():
            if service.get("image") == "brdfarm":
                for volume in service.get("volumes", []):
                    print(name, volume.split(":")[0])
        return 0
    found = list(faults(compose))
    for fault in found:
        print(fault, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
