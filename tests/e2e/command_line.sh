#!/usr/bin/env bash
# The command line: exit codes, stdout, JSON documents, and the life of a job.
. "$(dirname "$0")/farm.sh"

job=(--size 64x48 --spp 8 --tile-size 16)
square=$scenes/lit_square.gltf

# Wrong usage and bad input: 2. No farm: 3.
exits 2 tessera
exits 2 tessera render "$square" --no-such-option
exits 2 tessera render "$square" --size 0x10
exits 2 tessera render "$square" --tile-size 12
exits 2 tessera render "$square" --error nan
says "nan is not a number"
exits 2 tessera render "$square" -o "$work/x.exr" --report "$work/none/x.json"
says "directory is missing or not writable"
exits 2 tessera render "$square" -o "$work/x.exr" --report "$work/x.exr"
(cd /proc/self && exits 0 tessera render "$square" -o "$work/x.exr" "${job[@]}") # where nobody may write
exits 2 tessera render "$work/nothing.gltf"
says nothing.gltf
echo '{"asset":' >"$work/broken.gltf"
exits 2 tessera render "$work/broken.gltf"
says broken.gltf
exits 3 tessera list --server "unix:$work/nobody"
exits 2 tessera list --server 192.0.2.1:7420
exits 2 tessera-server --listen 0.0.0.0:0 --store "$work/refused"
[ ! -e "$work/refused/token" ] || fail "a server that was refused created a store"
exits 2 tessera-server check "$work/nothing"
says "$work/nothing is not a store"
exits 2 tessera-worker --server "unix:$work/nobody" --cache /proc/none
says "cache directory /proc/none: "
say "exit codes of wrong usage, bad input and no farm"

exits 0 tessera-worker debug-pixel "$square" --size 64x48 --pixel 32,24 --sample 1
says "vertex 0, depth 0"
says "sample 1 of pixel 32,24, frame 0: radiance ("
exits 2 tessera-worker debug-pixel "$square" --size 64x48 --pixel 64,0
says "outside the frame of 64x48"
exits 2 tessera-worker debug-pixel "$square" --pixel 1
say "debug-pixel prints the path of a sample"

# samples FILE OPTIONS…: prints the samples per pixel of a render with the configuration file FILE.
samples() {
  tessera --config "$1" render "$square" -o "$work/x.exr" --report "$work/x.json" --force --size 16x16 "${@:2}" \
    >"$work/x.log" 2>&1 || [ $? -eq 4 ] || fail "with the configuration of $1: $(cat "$work/x.log")"
  json "$work/x.json" 'int(d["frames"][0]["spp_mean"])'
}
printf '[render]\nspp = 8\n' >"$work/spp.toml"
printf '[render]\nerror = 0.9\nmax-spp = 32\n' >"$work/error.toml"
equal "a file of defaults" "$(samples "$work/spp.toml")" 8
equal "--error wins over its spp" "$(samples "$work/spp.toml" --error 0.9 --max-spp 32)" 32
equal "--spp wins over its error and max-spp" "$(samples "$work/error.toml" --spp 16)" 16

for program in tessera tessera-server tessera-worker; do
  exits 0 "$program" --version
  for part in "$program " "render contract " "isa " "gRPC " "protobuf " "libpng " "libjpeg-turbo " "libwebp " "OpenEXR "; do
    says "$part"
  done
  exits 0 "$program" --help
done
for shell in bash zsh fish; do
  exits 0 tessera completion "$shell"
  says render
done
exits 0 tessera completion bash
bash -n "$work/out" || fail "bash cannot read its completion script"
say "versions, help and completion"

start_server
# Without a worker a job waits; pause, resume and cancel work all the same.
id=$(farm submit "$square" "${job[@]}" --name first)
[[ $id =~ ^[a-z0-9]+$ ]] || fail "stdout of submit is not a job id: $id"
farm status "$id" --json >"$work/status.json"
equal "a job without workers is queued" "$(json "$work/status.json" 'd["state"]')" queued
exits 0 farm pause first
exits 0 farm pause first
equal "paused" "$(farm status last --json | python3 -c 'import json,sys; print(json.load(sys.stdin)["state"])')" paused
exits 0 farm resume "$id"
exits 0 farm cancel "$id"
exits 1 farm watch "$id"
exits 2 farm status nosuchjob
exits 2 farm fetch "$id" -o "$work/none"
say "pause, resume, cancel; a cancelled job's fate is 1"
exits 0 farm retry "$id"
start_worker a
exits 0 farm watch "$id" --json
tail -n 1 "$work/out" >"$work/last.json"
equal "retry finishes a cancelled job" "$(json "$work/last.json" 'd["state"]')" done

# Report and images; a second fetch keeps them, and another file in their place needs --force.
exits 0 farm report "$id" --json
cp "$work/out" "$work/report.json"
equal "the report's schema" "$(json "$work/report.json" 'd["schema"]')" tessera.report/1
exits 0 farm report "$id" --csv --svg "$work/curve.svg" --tiles "$work/tiles.svg" --trace "$work/trace.json"
says frame,cpu_seconds
for file in curve.svg tiles.svg trace.json; do [ -s "$work/$file" ] || fail "report did not write $file"; done
exits 0 farm fetch "$id" -o "$work/files" --json
equal "one file was written" "$(json "$work/out" '[f["state"] for f in d["frames"]]')" written
exits 0 farm fetch "$id" -o "$work/files" --json
equal "a second fetch leaves it" "$(json "$work/out" '[f["state"] for f in d["frames"]]')" present
echo spoiled >"$work/files/first.exr"
exits 2 farm fetch "$id" -o "$work/files"
exits 0 farm fetch "$id" -o "$work/files" --force
[ -z "$(find "$work/files" -name '*.part')" ] || fail "a .part file was left"
exits 0 farm fetch "$id" -o "$work/files" --format png
[ "$(head -c 4 "$work/files/first.png" | tail -c 3)" = PNG ] || fail "first.png is not a PNG file"
say "fetch: files, digests, --force, PNG"

# compare: equal images, a limit, images of different sizes.
exits 0 tessera compare "$work/files/first.exr" "$work/files/first.exr" --fail-above rmse=0 --json
equal "an image is itself" "$(json "$work/out" 'd["rmse"]')" 0.0
exits 0 farm submit "$square" "${job[@]}" --seed 9 --name other --wait
exits 0 farm fetch other -o "$work/files"
exits 1 tessera compare "$work/files/first.exr" "$work/files/other.exr" --fail-above rmse=1e-9
exits 2 tessera compare "$work/files/first.exr" "$scenes/lit_square.gltf"
say "compare"

# The reference of a crop may be the image of the whole frame or of the crop alone.
crop=("${job[@]}" --crop "16,8,24,32")
exits 0 tessera render "$square" "${job[@]}" -o "$work/whole.exr"
exits 0 tessera render "$square" "${crop[@]}" -o "$work/part.exr"
for reference in whole part; do
  exits 0 tessera render "$square" "${crop[@]}" --seed 9 --reference "$work/$reference.exr" \
    -o "$work/against.exr" --force --json
  cp "$work/out" "$work/$reference.json"
  exits 0 farm submit "$square" "${crop[@]}" --seed 9 --reference "$work/$reference.exr" --name "$reference" --wait
  exits 0 farm report "$reference" --json
  equal "the farm has the same true error" "$(json "$work/out" '"%.5g" % d["frames"][0]["true"]["error"]')" \
    "$(json "$work/$reference.json" '"%.5g" % d["frames"][0]["true"]["error"]')"
  exits 0 farm report "$reference" --json --reference "$work/whole.exr"
  equal "report tells the same" "$(json "$work/out" 'd["frames"][0]["true"]')" \
    "$(json "$work/$reference.json" 'd["frames"][0]["true"]')"
done
equal "both tell the same" "$(json "$work/whole.json" 'd["frames"][0]["true"]')" \
  "$(json "$work/part.json" 'd["frames"][0]["true"]')"
exits 2 tessera render "$square" "${job[@]}" --reference "$work/part.exr" -o "$work/none.exr"
says "part.exr: the reference is 24x32; expected 64x48"
say "references of crops"

# Lists with filters; the columns of what is special appear.
exits 0 farm list
[[ $(head -n 1 "$work/out") != *PROJECT* ]] || fail "list: a column PROJECT, but no job has one"
night=$(farm submit "$square" "${job[@]}" --name filtered --project film --pool night --priority 7)
exits 0 farm list --project film --state queued --state running --pool night --owner local
for word in AGE PRIORITY PROJECT POOL "$night" film night; do says "$word"; done
equal "one job matches" "$(wc -l <"$work/out")" 2
exits 0 farm list --project film --state done --json
equal "no job matches" "$(json "$work/out" 'len(d["jobs"])')" 0
exits 2 farm list --state nonsense
exits 0 farm status "$night"
says "owner"
exits 0 farm events --kind "job submitted" --limit 1 --json
equal "the newest submission" "$(json "$work/out" 'd["kind"] + " " + d["job"]')" "job submitted $night"
exits 2 farm events --kind nonsense
exits 0 farm cancel "$night"
exits 0 farm workers
says TAGS
exits 0 farm quotas
says "stored-gb"
exits 2 farm usage --since 2026-02-01 --until 2026-01-01
says "is not later than --since"
say "list and events with filters"

# Every JSON document names its schema.
for words in "list" "workers" "status $id" "report $id"; do
  # shellcheck disable=SC2086
  exits 0 farm $words --json
  schema=$(json "$work/out" 'd["schema"]')
  [[ $schema =~ ^tessera\.[a-z]+/[1-9]$ ]] || fail "$words --json: schema '$schema'"
done
exits 0 tessera inspect "$square" --json
[[ $(json "$work/out" 'd["schema"]') =~ ^tessera\.[a-z]+/[1-9]$ ]] || fail "inspect --json: no schema"
say "JSON documents have a schema"

# Files of several frames are numbered; extend fails once a job is done, because its blocks are deleted.
exits 0 farm submit "$scenes/same_bits.gltf" "${job[@]}" --max-depth 2 --frames 0-4x2 --name clip --wait
exits 0 farm fetch clip -o "$work/clip"
equal "frames get numbers" "$(cd "$work/clip" && echo *.exr)" "clip.0000.exr clip.0002.exr clip.0004.exr"
exits 0 farm remove clip
exits 2 farm status clip
say "several frames, remove"

# Ctrl-C in watch and submit --wait leaves the job running and prints that it keeps running.
kill_worker a
id=$(farm submit "$square" "${job[@]}" --name patient)
start_interruptible watch tessera watch --server "$socket" "$id" --json
wait_until 60 "watch has begun" test -s "$work/watch.out"
interrupted watch "$started"
grep -q 'keeps running' "$work/watch.err" || fail "watch did not report that the job keeps running"
start_interruptible submit tessera submit "$square" --server "$socket" "${job[@]}" --wait
wait_until 60 "the job is submitted" test -s "$work/submit.out"
interrupted submit "$started"
grep -q 'keeps running' "$work/submit.err" || fail "submit --wait did not report that the job keeps running"
exits 0 farm status "$id" --json
equal "the job is still there" "$(json "$work/out" 'd["state"]')" queued
say "Ctrl-C in watch and submit --wait"
