#!/bin/sh
# Sets the robot's clock once from the laptop's chrony, before the robot's stack starts. Without a clock chip it may be hours off.
# Usage: lupin-clock-sync.sh LAPTOP. Takes at most 25 s and always exits 0, because a wrong clock must not stop the boot.
PATH=/usr/sbin:/usr/bin:/sbin:/bin
LC_ALL=C
export PATH LC_ALL
laptop=$1
budget_s=25

# Seconds since power-on; no program sets this clock.
now_s() { read -r up rest </proc/uptime && echo "${up%%.*}"; }
end_s=$(($(now_s) + budget_s))
left_s() { echo $((end_s - $(now_s))); }
leave() {
  echo "$*; the clock is left as it is"
  exit 0
}

# A clock step breaks a running ros2_control: all its timeouts expire in one tick, and the wheels no longer react.
leave_if_live() {
  state=$(systemctl show --property=ActiveState --value mirte-ros.service 2>/dev/null)
  case $state in inactive | failed | '') ;; *) leave "mirte-ros is $state" ;; esac
  if pgrep -x ros2_control_no >/dev/null; then leave "ros2_control_node runs"; fi
}

reachability() { chronyc -c -n sources 2>/dev/null | awk -F, -v laptop="$laptop" '$3 == laptop { print $6 }'; }
stratum() { chronyc -c -n sources 2>/dev/null | awk -F, -v laptop="$laptop" '$3 == laptop { print $4 }'; }
offset_s() { chronyc -c tracking 2>/dev/null | awk -F, '{ print $5 }'; }

[ -n "$laptop" ] || leave "no laptop was named"
command -v chronyc >/dev/null || leave "chronyc is not installed"
leave_if_live
until ping -c 1 -W 1 "$laptop" >/dev/null 2>&1; do
  [ "$(left_s)" -gt 0 ] || leave "$laptop did not answer within $budget_s s"
  sleep 1
done

chronyc -n add server "$laptop" iburst >/dev/null 2>&1 # fails if chrony's configuration already has this server
chronyc -n online "$laptop" >/dev/null 2>&1
chronyc -n burst 4/4 "$laptop" >/dev/null 2>&1
burst_s=$(now_s)
# Reachability register, octal 7: the last three requests were answered. A single sample has set clocks six seconds wrong.
until [ "$(reachability || echo 0)" -ge 7 ] 2>/dev/null; do
  [ "$(left_s)" -gt 0 ] || leave "$laptop answers, but its chrony doesn't (allow and local stratum there?)"
  if [ $(($(now_s) - burst_s)) -ge 4 ]; then
    chronyc -n burst 2/2 "$laptop" >/dev/null 2>&1
    burst_s=$(now_s)
  fi
  sleep 1
done
# Without a selected source, makestep reports 200 OK and does nothing.
tries=$(left_s)
[ "$tries" -ge 1 ] || tries=1
[ "$tries" -le 15 ] || tries=15
chronyc waitsync "$tries" 0 0 1 >/dev/null 2>&1 || leave "chrony did not select $laptop"

leave_if_live
before=$(offset_s) # positive if this clock is behind
# A laptop without a battery for its clock starts in 1970. The limits are those of lupin_cli/plausible_time.py.
time_s=$(awk -v now="$(date +%s)" -v behind="$before" 'BEGIN { printf "%.0f", now + behind }')
if [ -n "$before" ] && { [ "$time_s" -lt 1735689600 ] || [ "$time_s" -ge 2366841600 ]; }; then
  leave "the time of $laptop is certainly wrong ($(date -u -d "@$time_s" +%F))"
fi
# A robot boots with the time of its last shutdown, so it is behind. If it is ahead of a laptop that follows no time source itself
# (`local stratum 10`), that laptop may be the wrong one, and chrony must not slew to its time either.
if [ "$(stratum)" -ge 10 ] 2>/dev/null && awk -v behind="$before" 'BEGIN { exit !(behind < -3) }'; then
  chronyc -n offline "$laptop" >/dev/null 2>&1
  leave "${before#-} s ahead of $laptop, which follows no time source (set it right, or on it: lupin sync-clock)"
fi
chronyc makestep >/dev/null || leave "chrony refused to step"
tries=$(left_s)
[ "$tries" -ge 1 ] || tries=1
[ "$tries" -le 15 ] || tries=15
if chronyc waitsync "$tries" 0.1 0 1 >/dev/null 2>&1; then
  echo "stepped to $laptop's time: $before s off before, $(offset_s) s now"
else
  echo "stepped to $laptop's time, but chrony is still $(offset_s) s off ($before s before)"
fi
exit 0
