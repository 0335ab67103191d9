"""Launch files, configuration, the campaign runner and the console.

nodes             the node table: processes, parameters, launch arguments; config: files as installed or as a plan names
plan              campaign.yaml to trials; run_order: in random blocks; foresight: what they will be able to find
folder            what lies where; provenance: what a bag says of its trial; endings: how a trial ends too early
runner            a campaign in batch, over worker processes; batch, trial_bag: one trial of it, and its bag
until             a campaign until a verdict; truth: the lab's sealed world, opened afterwards
live_node         a campaign over the real nodes
  queue           what is done and to come; streak: failures in a row; journal: what happened
  hold, hold_node may it go on, and the services for that
  desk_node       what the operator asks for
  campaign_node   one trial; gate_node, orders_node: may it begin, what is asked of the nodes
  hearing_node    what is heard; supervision: who has fallen silent; recorder_process: the recorder
console           the page's state; safety: legs and air; marks: pictures. console_node, console_page: heard and served;
  page_lease_node whoever starts something from the page is watched
scene             shapes for RViz and Foxglove; scene_messages, scene_node: as messages, and their node
tools/            campaign, unseal
"""
