// The protocol core of the LED driver on a host: lines in, answers out. A waveform that is played is printed edge by
// edge, as "@ <us since the begin> <level>", before its last answer: at once, or with the argument "slow" one edge
// before each further line.
#include <iostream>
#include <string>

#include "protocol.h"

static evs_led::Core core("emulated");

static uint64_t at_us = 0;

// Plays the next edge; the last answer if there is none.
static void step() {
  evs_led::Edge edge;
  if (core.next_edge(&edge)) {
    at_us += edge.delta_us;
    core.level = edge.level;
    std::cout << "@ " << at_us << " " << edge.level << "\n";
  } else {
    core.finish(0);
    std::cout << core.answer.bytes();
  }
}

int main(int count, char **) {
  const bool slow = count > 1;
  std::string line;
  while (std::getline(std::cin, line)) {
    if (core.playing) step();
    const evs_led::Action action = core.take(line.data(), line.size());
    std::cout << core.answer.bytes();
    if (action != evs_led::kPlay) continue;
    at_us = 0;
    std::cout << "@ 0 " << core.begin_level() << "\n";
    while (core.playing && !slow) step();
  }
  return 0;
}
