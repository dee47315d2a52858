# shellcheck shell=bash disable=SC2034,SC2154
# Starts emulators; read by try.sh. Each function starts one in the background on a free port,
# makes the bucket `farm`, exports where it is and with which keys, and sets
#
#   url       the bucket
#   signed    a pattern of its log: somebody sent an object by a signed URL
#   refuses   misuses of signed URLs that it refuses: other bytes under the MD5 that was signed
#             (damaged), or under none (undeclared), another key (elsewhere), too late (late)
#
# It keeps its data and its log, `emulator.log`, in the folder that it is called in.

installed="$root/target/buckets"
emulators=()

free_port() {
  python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'
}

# emulate LOG COMMAND...
emulate() {
  local log="$1"
  shift
  "$@" >"$log" 2>&1 &
  emulators+=($!)
}

stop_emulators() {
  for emulator in "${emulators[@]}"; do
    kill "$emulator" 2>/dev/null || true
    wait "$emulator" 2>/dev/null || true
  done
}

# Waits until something answers at a port, whatever it says.
await() {
  for _ in {1..150}; do
    curl --silent --output /dev/null "http://127.0.0.1:$1/" && return
    sleep 0.2
  done
  echo "buckets: nothing answers on port $1" >&2
  return 1
}

start_azure() {
  local port account=brdfarm key date text signature
  port="$(free_port)"
  key="$(openssl rand -base64 64 | tr -d '\n')"
  AZURITE_ACCOUNTS="$account:$key" emulate emulator.log \
    "$installed/azurite/node_modules/.bin/azurite-blob" --disableTelemetry \
    --blobHost 127.0.0.1 --blobPort "$port" --location azurite
  await "$port"
  # The program makes no containers: this is the one request that has to be signed by hand.
  date="$(LC_ALL=C date -u '+%a, %d %b %Y %H:%M:%S GMT')"
  text="$(printf 'PUT\n\n\n\n\n\n\n\n\n\n\n\nx-ms-date:%s\nx-ms-version:2020-04-08\n/%s/%s/farm\nrestype:container' \
    "$date" "$account" "$account")"
  signature="$(printf %s "$text" | openssl dgst -sha256 -binary -mac HMAC \
    -macopt "hexkey:$(printf %s "$key" | base64 -d | od -An -v -tx1 | tr -d ' \n')" | base64)"
  curl --silent --show-error --fail --request PUT --header 'content-length: 0' \
    --header "x-ms-date: $date" --header 'x-ms-version: 2020-04-08' \
    --header "authorization: SharedKey $account:$signature" \
    "http://127.0.0.1:$port/$account/farm?restype=container"
  export AZURE_STORAGE_USE_EMULATOR=true AZURITE_BLOB_STORAGE_URL="http://127.0.0.1:$port"
  export AZURE_STORAGE_ACCOUNT_NAME="$account" AZURE_STORAGE_ACCOUNT_KEY="$key"
  url=az://farm
  # Azure's signatures cover neither MD5 nor size.
  refuses=damaged,elsewhere,late
  signed='"PUT /brdfarm/farm/.*[?&]sig=.* 201'
}

start_gcs() {
  local emulator port
  emulator="$(free_port)"
  emulate gcp-storage-emulator.log \
    "$installed/gcs/bin/gcp-storage-emulator" \
    start --in-memory --host 127.0.0.1 --port "$emulator" --default-bucket farm
  await "$emulator"
  openssl genpkey -quiet -algorithm RSA -pkeyopt rsa_keygen_bits:2048 -out key.pem
  openssl pkey -in key.pem -pubout -out public.pem
  port="$(free_port)"
  emulate emulator.log \
    "$installed/gcs/bin/python" "$root/tests/buckets/gcs_xml.py" "$port" "$emulator" public.pem farm
  await "$port"
  python3 - >account.json <<'PYTHON'
import json
account = {"type": "service_account", "client_email": "farm@example.iam.gserviceaccount.com",
           "private_key_id": "1", "private_key": open("key.pem").read()}
print(json.dumps(account))
PYTHON
  export GOOGLE_SERVICE_ACCOUNT="$PWD/account.json"
  export GOOGLE_BASE_URL="http://127.0.0.1:$port" GOOGLE_ALLOW_HTTP=true
  url=gs://farm
  refuses=damaged,undeclared,elsewhere,late
  signed='"PUT /[^/]*/.*X-Goog-Signature=.* 200'
}

s3_environment() {
  export AWS_ENDPOINT_URL="http://127.0.0.1:$1" AWS_ALLOW_HTTP=true AWS_REGION=us-east-1
  export AWS_ACCESS_KEY_ID=brdfarm AWS_SECRET_ACCESS_KEY="$2"
  url=s3://farm
}

start_moto() {
  local port
  port="$(free_port)"
  emulate emulator.log "$installed/moto/bin/moto_server" -H 127.0.0.1 -p "$port"
  await "$port"
  curl --silent --show-error --fail --request PUT "http://127.0.0.1:$port/farm"
  s3_environment "$port" not-a-secret
  # It checks neither signatures nor MD5s.
  refuses=
  signed='"PUT /[^/]*/.*X-Amz-Signature=.* 200'
}

start_s3s() {
  local port secret
  port="$(free_port)"
  secret="$(openssl rand -hex 24)"
  mkdir -p s3s/farm
  RUST_LOG=debug NO_COLOR=1 emulate emulator.log "$installed/s3s/bin/s3s-fs" --host 127.0.0.1 \
    --port "$port" --access-key brdfarm --secret-key "$secret" s3s
  await "$port"
  s3_environment "$port" "$secret"
  refuses=damaged,undeclared,elsewhere,late
  signed='req: Request \{ method: PUT, .*X-Amz-Signature='
}
