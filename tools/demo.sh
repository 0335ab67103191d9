#!/usr/bin/env bash
# The main job on the virtual lab, with the commands a user types: run it live, run it blind in batch, compare, discover,
# and only then open the truth. Exit code 1 where the live part failed or the verdict was wrong.
set -euo pipefail
out=$1
seed=$2
tools=$(dirname "$0")

refuse() { echo "demo: error: $*" >&2; exit 2; }
step() { printf '\n\033[1m%s\033[0m\n' "$*"; }

# What is there will be removed: an earlier demo of this name may be, nothing else.
refuse_all_but_a_demo() {
  if [[ -e $1 || -L $1 ]] && ! rmdir -- "$1" 2>/dev/null; then
    [[ -d $1/trials ]] && grep -qsx "name: $2" "$1/campaign.yaml" ||
      refuse "DEMO_OUT: $1 is no earlier demo (campaign.yaml with 'name: $2', and trials/), so it stays; name another"
  fi
}

[[ $seed =~ ^[0-9]{0,9}$ ]] || refuse "SEED: '$seed' is not a whole number from 0 to 999999999"
[[ -n $out ]] || refuse "DEMO_OUT: a folder's name is needed"
live=$out-live
refuse_all_but_a_demo "$out" demo
refuse_all_but_a_demo "$live" demo-live

config=$(ros2 run sandbot_bringup campaign --config-folder)
rm -rf -- "$out" "$live"

step "1/5  live: two trials of the paper's SandBot over the real nodes (DDS), on loosely and on closely packed ground"
failed=0
python "$tools/demo_live.py" "$live" || failed=$?
((failed != 130)) || exit 130  # Ctrl-C

if [[ -n $seed ]]; then
  hidden=(--hide "$seed") model=li09
  step "2/5  blind campaign: 147 trials on the virtual lab; an effect drawn from seed $seed is hidden in it in addition to the paper's"
else
  hidden=() model=simple
  step "2/5  blind campaign: 147 trials on the virtual lab, whose world is sealed"
fi
ros2 run sandbot_bringup campaign "$config/li09_demo.yaml" --out "$out" --batch --world "$config/li09_world.yaml" "${hidden[@]}"
step "3/5  compare: the $model model against the measurements"
ros2 run sandbot_model compare "$out" --model $model
step "4/5  discover: which physical effects are missing"
ros2 run sandbot_model discover "$out" --model $model --json "$out/discovery.json" --html "$out/report.html"
ros2 run sandbot_model atlas "$out" --model $model --effects "$(python "$tools/demo_found.py" --effects "$out")" | tail -n 1
step "5/5  the sealed truth is opened"
ros2 run sandbot_bringup unseal "$out" || failed=1
python "$tools/demo_found.py" "$out"
exit $((failed != 0))
