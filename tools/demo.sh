#!/usr/bin/env bash
# The main job on the virtual lab, with the commands a user types: run, look, discover, and only then open the truth.
set -euo pipefail
out=$1
seed=$2

refuse() { echo "demo: $*" >&2; exit 2; }
step() { printf '\n\033[1m%s\033[0m\n' "$*"; }

[[ $seed =~ ^[0-9]{1,9}$ ]] || refuse "SEED: '$seed' is not a whole number from 0 to 999999999"
[[ -n $out ]] || refuse "DEMO_OUT: a folder's name is needed"
# What is there will be removed: an earlier demo may be, nothing else.
if [[ -e $out || -L $out ]] && ! rmdir -- "$out" 2>/dev/null; then
  [[ -d $out/trials ]] && grep -qsx 'name: demo' "$out/campaign.yaml" ||
    refuse "DEMO_OUT: $out is no earlier demo (campaign.yaml with 'name: demo', and trials/), so it stays; name another"
fi

config=$(ros2 run sandbot_bringup campaign --config-folder)
rm -rf -- "$out"
step "1/4  campaign: 105 trials on the virtual lab, an effect drawn from seed $seed and sealed"
ros2 run sandbot_bringup campaign "$config/demo.yaml" --out "$out" --batch --hide "$seed"
step "2/4  compare: the base model against the measurements"
ros2 run sandbot_model compare "$out"
step "3/4  discover: which physical effect is missing"
ros2 run sandbot_model discover "$out" --json "$out/discovery.json" --html "$out/report.html"
step "4/4  the sealed truth is opened"
ros2 run sandbot_bringup unseal "$out"
