#!/usr/bin/env python3
"""Google Cloud Storage's XML API in front of an emulator that has its JSON API.

The program speaks the XML API, as the crate object_store does. The emulators of Google Cloud
Storage speak the JSON API, and of the XML API only parts: gcp-storage-emulator knows no HEAD, no
list, no copy and no multipart upload. This server translates each request, and checks what the
emulators do not look at: the bearer token of the service account, signatures of signed URLs
(GOOG4-RSA-SHA256) with their time and their headers, and Content-MD5. It follows Google's
documentation of the XML API and of signatures; Google's own servers have not seen the program.

    gcs_xml.py PORT EMULATOR_PORT PUBLIC_KEY.pem BUCKET
"""

import base64
import hashlib
import http.client
import json
import secrets
import sys
import threading
import time
from datetime import datetime, timedelta, timezone
from email.utils import format_datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qsl, quote, unquote, urlsplit
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import padding

# The name that Google's servers are called by; signatures cover it.
HOST = "storage.googleapis.com"
# Objects in a page of a list.
PAGE = 1000
# Parts of uploads lie here until the upload is complete. No list shows them.
PARTS = ".parts/"


class Refused(Exception):
    """An answer other than success: its status and its reason."""

    def __init__(self, status, code):
        super().__init__(code)
        self.status = status
        self.code = code


class Emulator:
    """The JSON API of an emulator, one bucket of it."""

    def __init__(self, port, bucket):
        self.port = port
        self.bucket = bucket
        # gcp-storage-emulator answers one request at a time and lets five connections wait: more
        # would be dropped, and tried again after seconds.
        self.turn = threading.Lock()

    def call(self, method, path, body=None, headers=None):
        """Returns status, headers and body."""
        with self.turn:
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
            try:
                connection.request(method, path, body, headers or {})
                answer = connection.getresponse()
                return answer.status, answer.headers, answer.read()
            finally:
                connection.close()

    def expect(self, method, path, body=None, headers=None):
        status, _, content = self.call(method, path, body, headers)
        if status == 404:
            raise Refused(404, "NoSuchKey")
        if status >= 300:
            raise Refused(500, f"the emulator answers {status}")
        return content

    def path(self, name):
        return f"/storage/v1/b/{self.bucket}/o/{quote(name, safe='')}"

    def look(self, name):
        return json.loads(self.expect("GET", self.path(name)))

    def read(self, name, byte_range):
        headers = {"Range": byte_range} if byte_range else {}
        status, answered, content = self.call("GET", self.path(name) + "?alt=media", None, headers)
        if status not in (200, 206):
            raise Refused(status, "NoSuchKey" if status == 404 else "InvalidRange")
        return status, answered.get("Content-Range"), content

    def write(self, name, content):
        path = f"/upload/storage/v1/b/{self.bucket}/o?uploadType=media&name={quote(name, safe='')}"
        headers = {"Content-Type": "application/octet-stream"}
        if not content:
            # gcp-storage-emulator reads an empty body as none, and fails.
            raise Refused(500, "the emulator takes no empty object")
        return json.loads(self.expect("POST", path, content, headers))

    def copy(self, source, name):
        path = f"{self.path(source)}/rewriteTo/b/{self.bucket}/o/{quote(name, safe='')}"
        told = self.expect("POST", path, b"{}", {"Content-Type": "application/json"})
        return json.loads(told)["resource"]

    def compose(self, parts, name):
        told = {"sourceObjects": [{"name": part} for part in parts], "destination": {}}
        headers = {"Content-Type": "application/json"}
        path = self.path(name) + "/compose"
        return json.loads(self.expect("POST", path, json.dumps(told).encode(), headers))

    def remove(self, name):
        self.expect("DELETE", self.path(name))

    def list(self, prefix):
        path = f"/storage/v1/b/{self.bucket}/o?prefix={quote(prefix, safe='')}"
        found = json.loads(self.expect("GET", path)).get("items") or []
        found = [entry for entry in found if not entry["name"].startswith(PARTS)]
        return sorted(found, key=lambda entry: entry["name"].encode())


def verify(key, signature, message):
    try:
        key.verify(signature, message, padding.PKCS1v15(), hashes.SHA256())
    except InvalidSignature:
        raise Refused(403, "SignatureDoesNotMatch") from None


def check_bearer(key, authorization):
    """A token that the service account signed itself, and that is still good."""
    token = (authorization or "").removeprefix("Bearer ").split(".")
    if len(token) != 3:
        raise Refused(401, "AuthenticationRequired")
    parts = [base64.urlsafe_b64decode(part + "=" * (-len(part) % 4)) for part in token]
    verify(key, parts[2], f"{token[0]}.{token[1]}".encode())
    if json.loads(parts[1])["exp"] < time.time():
        raise Refused(401, "ExpiredToken")


def check_signed_url(key, method, path, query, headers):
    """docs: cloud.google.com/storage/docs/authentication/canonical-requests"""
    asked = dict(query)
    signed_at = datetime.strptime(asked["X-Goog-Date"], "%Y%m%dT%H%M%SZ")
    signed_at = signed_at.replace(tzinfo=timezone.utc)
    if datetime.now(timezone.utc) > signed_at + timedelta(seconds=int(asked["X-Goog-Expires"])):
        raise Refused(400, "ExpiredToken")
    names = asked["X-Goog-SignedHeaders"].split(";")
    values = {name: HOST if name == "host" else headers.get(name) for name in names}
    if None in values.values():
        raise Refused(403, "SignatureDoesNotMatch")
    strict = [(quote(k, safe="-._~"), quote(v, safe="-._~")) for k, v in query]
    strict = sorted(pair for pair in strict if pair[0] != "X-Goog-Signature")
    lines = [method, path, "&".join(f"{k}={v}" for k, v in strict)]
    lines += [f"{name}:{' '.join(values[name].split())}" for name in names]
    lines += ["", ";".join(names), "UNSIGNED-PAYLOAD"]
    request = hashlib.sha256("\n".join(lines).encode()).hexdigest()
    scope = asked["X-Goog-Credential"].split("/", 1)[1]
    text = f"GOOG4-RSA-SHA256\n{asked['X-Goog-Date']}\n{scope}\n{request}"
    verify(key, bytes.fromhex(asked["X-Goog-Signature"]), text.encode())


def tag(entry):
    """The entity tag of the XML API: the MD5 in hex where the object was sent as one."""
    md5 = entry.get("md5Hash")
    return '"' + (base64.b64decode(md5).hex() if md5 else entry["etag"].strip('"')) + '"'


def changed(entry):
    return datetime.fromisoformat(entry["updated"].replace("Z", "+00:00"))


class Uploads:
    """Multipart uploads that are under way."""

    def __init__(self):
        self.lock = threading.Lock()
        self.parts = {}

    def begin(self):
        name = secrets.token_hex(16)
        with self.lock:
            self.parts[name] = {}
        return name

    def put(self, upload, number, part):
        with self.lock:
            if upload not in self.parts:
                raise Refused(404, "NoSuchUpload")
            self.parts[upload][number] = part

    def end(self, upload):
        with self.lock:
            if upload not in self.parts:
                raise Refused(404, "NoSuchUpload")
            return self.parts.pop(upload)


class XmlApi(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    key = None
    emulator = None
    uploads = Uploads()

    def do_any(self):
        length = int(self.headers.get("Content-Length") or 0)
        self.content = self.rfile.read(length)
        try:
            url = urlsplit(self.path)
            self.query = parse_qsl(url.query, keep_blank_values=True)
            self.asked = dict(self.query)
            if "X-Goog-Signature" in self.asked:
                check_signed_url(self.key, self.command, url.path, self.query, self.headers)
            else:
                check_bearer(self.key, self.headers.get("Authorization"))
            bucket, _, name = url.path[1:].partition("/")
            if unquote(bucket) != self.emulator.bucket:
                raise Refused(404, "NoSuchBucket")
            self.serve(unquote(name))
        except Refused as refused:
            self.answer(refused.status, f"<Error><Code>{escape(refused.code)}</Code></Error>")

    do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = do_any

    def serve(self, name):
        if self.command in ("GET", "HEAD"):
            self.get(name) if name else self.list()
        elif self.command == "PUT" and "x-goog-copy-source" in self.headers:
            source = unquote(self.headers["x-goog-copy-source"]).partition("/")[2]
            self.written(self.emulator.copy(source, name), "<CopyObjectResult/>")
        elif self.command == "PUT":
            self.put(name)
        elif self.command == "POST" and "uploads" in self.asked:
            upload = self.uploads.begin()
            self.answer(
                200,
                f"<InitiateMultipartUploadResult><UploadId>{upload}</UploadId>"
                "</InitiateMultipartUploadResult>",
            )
        elif self.command == "POST":
            self.complete(name)
        elif "uploadId" in self.asked:
            for part in self.uploads.end(self.asked["uploadId"]).values():
                self.emulator.remove(part)
            self.answer(204, "")
        else:
            self.emulator.remove(name)
            self.answer(204, "")

    def put(self, name):
        declared = self.headers.get("Content-MD5")
        found = base64.b64encode(hashlib.md5(self.content).digest()).decode()
        if declared is not None and declared != found:
            raise Refused(400, "BadDigest")
        if "uploadId" in self.asked:
            number = int(self.asked["partNumber"])
            name = f"{PARTS}{self.asked['uploadId']}/{number:05}"
            self.uploads.put(self.asked["uploadId"], number, name)
        self.written(self.emulator.write(name, self.content), "")

    def written(self, entry, text):
        told = {"ETag": tag(entry), "x-goog-generation": entry["generation"]}
        self.answer(200, text, told)

    def complete(self, name):
        parts = self.uploads.end(self.asked["uploadId"])
        wanted = [int(node.text) for node in ElementTree.fromstring(self.content).iter("PartNumber")]
        if wanted != sorted(parts):
            raise Refused(400, "InvalidPart")
        entry = self.emulator.compose([parts[number] for number in wanted], name)
        for part in parts.values():
            self.emulator.remove(part)
        told = f"<ETag>{escape(tag(entry))}</ETag>"
        self.answer(
            200, f"<CompleteMultipartUploadResult>{told}</CompleteMultipartUploadResult>"
        )

    def get(self, name):
        entry = self.emulator.look(name)
        told = {
            "ETag": tag(entry),
            "Last-Modified": format_datetime(changed(entry), usegmt=True),
            "x-goog-generation": entry["generation"],
        }
        if self.command == "HEAD":
            self.answer(200, b"", told, int(entry["size"]))
            return
        status, byte_range, content = self.emulator.read(name, self.headers.get("Range"))
        if byte_range:
            told["Content-Range"] = byte_range
        self.answer(status, content, told)

    def list(self):
        prefix = self.asked.get("prefix", "")
        after = self.asked.get("continuation-token") or self.asked.get("start-after", "")
        found = self.emulator.list(prefix)
        found = [entry for entry in found if entry["name"].encode() > after.encode()]
        page = found[: int(self.asked.get("max-keys", PAGE))]
        text = f"<ListBucketResult><Prefix>{escape(prefix)}</Prefix>"
        if len(page) < len(found):
            token = escape(page[-1]["name"])
            text += f"<NextContinuationToken>{token}</NextContinuationToken>"
        for entry in page:
            text += f"<Contents><Key>{escape(entry['name'])}</Key><Size>{entry['size']}</Size>"
            text += f"<LastModified>{changed(entry).isoformat()}</LastModified>"
            text += f"<ETag>{escape(tag(entry))}</ETag></Contents>"
        self.answer(200, text + "</ListBucketResult>")

    def answer(self, status, content, headers=None, length=None):
        if isinstance(content, str):
            content = content.encode()
        self.send_response(status)
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        if status != 204:
            self.send_header("Content-Length", str(len(content) if length is None else length))
        self.end_headers()
        if self.command != "HEAD" and status != 204:
            self.wfile.write(content)


class Server(ThreadingHTTPServer):
    request_queue_size = 128


def main():
    port, emulator_port, key, bucket = sys.argv[1:]
    with open(key, "rb") as file:
        XmlApi.key = serialization.load_pem_public_key(file.read())
    XmlApi.emulator = Emulator(int(emulator_port), bucket)
    Server(("127.0.0.1", int(port)), XmlApi).serve_forever()


if __name__ == "__main__":
    main()
