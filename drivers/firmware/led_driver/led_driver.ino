// An LED driver that times the edges of a waveform itself, for Teensy, SAMD, RP2040, ESP32 and other 32-bit boards.
// Wiring and protocol: README.md.

#include <Arduino.h>
#include <SPI.h>

// The board. Levels are codes of the DAC; EVS_LED_DAC_BITS says how many bits it has.
#define EVS_LED_SERIAL "1"        // a number for each board that is built; no spaces
#define EVS_LED_DAC_SPI 1         // 1: a 16-bit DAC8551 on SPI; 0: the DAC of the microcontroller
#if EVS_LED_DAC_SPI
#define EVS_LED_DAC_BITS 16
#else
#define EVS_LED_DAC_BITS 12
#endif

#include "protocol.h"

static const int kTriggerPin = 2;
static const int kDacSelectPin = 10;  // SYNC of the DAC8551
#if !EVS_LED_DAC_SPI
static const int kDacPin = A14;  // A14 on a Teensy 3.2, DAC0 on a Due, A0 on a SAMD21
#endif

// So long before an edge nothing else is done, us: no byte of the host can make it late.
static const int32_t kQuietUs = 200;

static evs_led::Core core(EVS_LED_SERIAL);
static char line[evs_led::kLongestLine];
static size_t line_length = 0;
static bool line_too_long = false;
static uint32_t heard_ms = 0;

static bool edge_ahead = false;  // else the end is ahead
static evs_led::Edge edge;
static uint32_t due_us = 0;
static uint32_t latest_us = 0;
static bool trigger_high = false;

static void write_level(uint32_t level) {
#if EVS_LED_DAC_SPI
  digitalWrite(kDacSelectPin, LOW);
  SPI.transfer(0);  // normal operation
  SPI.transfer16((uint16_t)level);
  digitalWrite(kDacSelectPin, HIGH);  // the output changes here
#else
  analogWrite(kDacPin, (int)level);
#endif
}

static void send_answer() { Serial.write((const uint8_t *)core.answer.bytes(), core.answer.length()); }

static void look_ahead() {
  edge_ahead = core.next_edge(&edge);
  due_us += edge_ahead ? edge.delta_us : core.end_us();
}

static void begin_play() {
  write_level(core.begin_level());
  due_us = micros();
  latest_us = 0;
  look_ahead();
}

// Does what is due.
static void play() {
  const int32_t ahead_us = (int32_t)(due_us - micros());
  if (ahead_us > 0) return;
  if (!edge_ahead) {
    core.finish(latest_us);
    heard_ms = millis();
    send_answer();
    return;
  }
  write_level(edge.level);
  trigger_high = !trigger_high;
  digitalWrite(kTriggerPin, trigger_high ? HIGH : LOW);
  core.level = edge.level;
  if ((uint32_t)-ahead_us > latest_us) latest_us = (uint32_t)-ahead_us;
  look_ahead();
}

static void take_line() {
  heard_ms = millis();
  const evs_led::Action action = core.take(line, line_too_long ? 0 : line_length);
  if (action == evs_led::kSetLevel) {
    write_level(core.level);
    trigger_high = false;  // here and not when a waveform begins: the camera takes each change for an edge
    digitalWrite(kTriggerPin, LOW);
  }
  send_answer();
  if (action == evs_led::kPlay) begin_play();
}

static void listen() {
  if (!Serial.available()) return;
  const char byte = (char)Serial.read();
  if (byte == '\n') {
    take_line();
    line_length = 0;
    line_too_long = false;
  } else if (line_length < sizeof line) {
    line[line_length++] = byte;
  } else {
    line_too_long = true;
  }
}

static void watch() {
  if (core.watchdog_ms && core.level && millis() - heard_ms >= core.watchdog_ms) {
    core.say_watchdog();
    write_level(0);
    send_answer();
  }
}

void setup() {
  pinMode(kTriggerPin, OUTPUT);
  digitalWrite(kTriggerPin, LOW);
#if EVS_LED_DAC_SPI
  pinMode(kDacSelectPin, OUTPUT);
  digitalWrite(kDacSelectPin, HIGH);
  SPI.begin();
  SPI.beginTransaction(SPISettings(20000000, MSBFIRST, SPI_MODE1));
#else
  analogWriteResolution(EVS_LED_DAC_BITS);
#endif
  write_level(0);
  Serial.begin(115200);
  core.say_boot();
  send_answer();
}

void loop() {
  if (core.playing) {
    play();
    if (core.playing && (int32_t)(due_us - micros()) < kQuietUs) return;
  } else {
    watch();
  }
  listen();
}
