#!/usr/bin/env bash
# A report beyond gRPC's default message limit of 4 MiB reaches every command that reads it, and workers with as many
# and as long tags as are allowed can be listed and banned.
#
# SIZE and FRAMES: the job (8x8 pixels, 3,400 frames). SIZE=512x512 FRAMES=60 has 245,760 units.
. "$(dirname "$0")/farm.sh"
limit_bytes=$((4 << 20))
frames=${FRAMES:-3400}
bytes() { stat -c %s "$1"; }
# complete REPORT: checks that it contains every frame.
complete() {
  equal "$1 contains all frames" "$(json "$work/$1" 'len(d["frames"])')" "$frames"
  equal "$1 says that they are done" "$(json "$work/$1" 'd["units"]["committed"] == d["units"]["total"]')" True
}

mkdir "$work/images"
exits 0 tessera render "$scenes/lit_square.gltf" --size "${SIZE:-8x8}" --tile-size 8 --spp 8 --frames "1-$frames" \
  --store "$work/store" --output "$work/images/f.exr" --report "$work/render.json"
complete render.json
equal "render writes all images" "$(find "$work/images" -name '*.exr' | wc -l)" "$frames"

start_server
farm report last --json >"$work/report.json"
[ "$(bytes "$work/report.json")" -gt "$limit_bytes" ] || fail "the report has only $(bytes "$work/report.json") bytes"
say "the report has $(bytes "$work/report.json") bytes"
complete report.json
exits 0 farm report last
exits 0 farm watch last --json
grep -q '"state": *"done"' "$work/out" || fail "watch does not show the end of the job"
say "report and watch read it"

# Tags: the 64 longest.
tags=$(python3 -c 'print(",".join(f"{i:064d}" for i in range(64)))')
for name in one two three; do start_worker "$name" --id "$name" --tags "$tags"; done
all_are_listed() {
  farm workers --json >"$work/workers.json" && [ "$(json "$work/workers.json" 'len(d["workers"])')" = 3 ]
}
wait_until 60 "three workers are connected" all_are_listed
equal "all tags are listed" "$(json "$work/workers.json" '[len(set(w["tags"])) for w in d["workers"]]')" "64 64 64"
exits 0 farm workers ban two
farm workers --json >"$work/workers.json"
equal "one is banned" "$(json "$work/workers.json" '[w["id"] for w in d["workers"] if w["state"] == "quarantined"]')" two
job=$(farm submit "$scenes/lit_square.gltf" --size 48x32 --spp 8 --require-tag "$(printf %064d 63)")
exits 0 farm watch "$job"
say "a job finds workers by the last tag"
exits 3 tessera-worker --server "$socket" --name four --threads 1 --cache "$work/cache-four" --tags "$tags,more"
says "hello.tags: 65 is not in [0, 64]"
say "more tags are refused"
