"""Launch files, configuration, the campaign runner and the console.

node_table        the nodes of a launch: processes, parameters, arguments; config: files installed or named by a plan
plan              campaign.yaml to trials; run_order: in random blocks; power_analysis: which effects they could detect
folder            the campaign folder's layout; provenance: a bag's record of its trial; endings: how a trial ends early
runner            a campaign in batch, over worker processes; batch, trial_bag: one trial of it, and its bag
until             a campaign until a verdict; truth: the lab's sealed world, opened afterwards
queue             trials done and to come; streak: repeated failures; journal: log of events
preparation       whether a requested preparation of the bed has ended
hold              whether the campaign may go on; supervision: who has fallen silent; recorder_process: the recorder
console           the page's state; safety: legs and air; marks: pictures; console_page: its HTTP
scene             shapes for RViz and Foxglove; scene_messages: as messages
nodes/
  live_node       a campaign over the real nodes
    campaign_node one trial; preflight_node: checks before it; services_node: calls to other nodes
    monitor_node  state and health of the nodes
    hold_node     the services stop, pause and go; operator_node: the operator's commands
  console_node    the page's ROS; page_lease_node: the lease for what is started from the page
  scene_node      the shapes' node
tools/            campaign, unseal
"""
