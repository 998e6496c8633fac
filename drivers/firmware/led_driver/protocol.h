// The protocol of the LED driver: lines, checksums, the stored waveform. No hardware here: it compiles on any host.
// README.md has all commands.
#ifndef EVS_LED_PROTOCOL_H
#define EVS_LED_PROTOCOL_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifndef EVS_LED_MAX_EDGES
#define EVS_LED_MAX_EDGES 4096  // 8 bytes each
#endif
#ifndef EVS_LED_DAC_BITS
#define EVS_LED_DAC_BITS 16
#endif
#ifndef EVS_LED_SHORTEST_US
#define EVS_LED_SHORTEST_US 20  // between two edges
#endif
#ifndef EVS_LED_TICK_US
#define EVS_LED_TICK_US 1  // resolution of the clock that times the edges
#endif

namespace evs_led {

static const size_t kLongestLine = 240;  // bytes, with LF
static const size_t kMostPairs = 64;     // of a line of edges: more do not fit
static const uint32_t kLongestUs = 2000000000UL;

// CRC-16/CCITT-FALSE: polynomial 0x1021, from 0xFFFF, nothing reflected.
inline uint16_t crc16(const char *data, size_t length) {
  uint16_t crc = 0xFFFF;
  for (size_t i = 0; i < length; ++i) {
    crc ^= (uint16_t)((uint16_t)(uint8_t)data[i] << 8);
    for (int bit = 0; bit < 8; ++bit) {
      crc = (uint16_t)((crc & 0x8000) ? (crc << 1) ^ 0x1021 : crc << 1);
    }
  }
  return crc;
}

// A line that is put together; what does not fit is left out.
class Line {
 public:
  Line() { clear(); }
  void clear() { length_ = 0; bytes_[0] = '\0'; }
  const char *bytes() const { return bytes_; }
  size_t length() const { return length_; }
  bool equals(const char *other, size_t length) const {
    return length == length_ && memcmp(bytes_, other, length) == 0;
  }
  void set(const char *other, size_t length) {
    clear();
    for (size_t i = 0; i < length; ++i) put(other[i]);
  }
  Line &text(const char *text) {
    while (*text) put(*text++);
    return *this;
  }
  Line &number(uint64_t value) {
    char digits[21];
    int count = 0;
    do {
      digits[count++] = (char)('0' + (int)(value % 10));
      value /= 10;
    } while (value);
    while (count) put(digits[--count]);
    return *this;
  }
  Line &end() {  // checksum and LF
    const uint16_t crc = crc16(bytes_, length_);
    put('*');
    for (int shift = 12; shift >= 0; shift -= 4) put("0123456789ABCDEF"[(crc >> shift) & 15]);
    put('\n');
    return *this;
  }

 private:
  void put(char byte) {
    if (length_ < kLongestLine) {
      bytes_[length_++] = byte;
      bytes_[length_] = '\0';
    }
  }
  char bytes_[kLongestLine + 1];
  size_t length_;
};

// Returns how long the text of a line (without LF) is, or 0 if the line is not what was sent.
inline size_t text_length(const char *line, size_t length) {
  if (length < 6 || length >= kLongestLine || line[length - 5] != '*') return 0;
  const uint16_t crc = crc16(line, length - 5);
  for (size_t i = 0; i < 4; ++i) {
    if (line[length - 4 + i] != "0123456789ABCDEF"[(crc >> (12 - 4 * i)) & 15]) return 0;
  }
  for (size_t i = 0; i < length - 5; ++i) {
    if (line[i] < 0x20 || line[i] > 0x7E) return 0;
  }
  return length - 5;
}

// Reads the words of a text, which one space separates.
class Words {
 public:
  Words(const char *text, size_t length) : at_(text), end_(text + length), more_(true) {}
  bool more() const { return more_; }
  bool next(const char **word, size_t *length) {
    if (!more_) return false;
    *word = at_;
    while (at_ < end_ && *at_ != ' ') ++at_;
    *length = (size_t)(at_ - *word);
    more_ = at_ < end_;
    if (more_) ++at_;
    return true;
  }
  // Reads exactly `count` numbers, and nothing after them.
  bool numbers(uint32_t *values, int count) {
    for (int i = 0; i < count; ++i) {
      const char *word;
      size_t length;
      if (!next(&word, &length) || !number(word, length, &values[i])) return false;
    }
    return !more_;
  }
  static bool number(const char *word, size_t length, uint32_t *value) {
    if (length < 1 || length > 10) return false;
    uint64_t sum = 0;
    for (size_t i = 0; i < length; ++i) {
      if (word[i] < '0' || word[i] > '9') return false;
      sum = sum * 10 + (uint64_t)(word[i] - '0');
    }
    *value = (uint32_t)sum;
    return sum <= 0xFFFFFFFFULL;
  }

 private:
  const char *at_;
  const char *end_;
  bool more_;
};

struct Edge {
  uint32_t delta_us;  // since the edge before, or the begin
  uint16_t level;
};

// What the hardware has to do after a line.
enum Action { kNothing, kSetLevel, kPlay };

// The device without its hardware.
class Core {
 public:
  Core(const char *serial) : serial_(serial) { start(); }

  Line answer;  // to the last line, to be sent
  uint32_t level;
  bool playing;
  uint32_t watchdog_ms;

  // Takes a line without its LF, and says what to do; `answer` is set.
  Action take(const char *line, size_t length) {
    const size_t text = text_length(line, length);
    size_t digits = 0;
    while (digits < text && line[digits] != ' ') ++digits;
    uint32_t ignored;
    if (!text || digits > 5 || !Words::number(line, digits, &ignored)) {
      answer.clear();
      answer.text("? error 1 garbled").end();
      return kNothing;
    }
    const char *command = line + digits + (digits < text ? 1 : 0);
    const size_t command_length = text - (size_t)(command - line);
    if (last_request_.equals(line, length) && !is(command, command_length, "hello")) {
      answer = last_answer_;
      return kNothing;
    }
    last_request_.set(line, length);
    number_.set(line, digits);
    const Action action = obey(command, command_length);
    answer.end();
    last_answer_ = answer;
    return action;
  }

  // The next edge of the waveform that is played; false when there is none.
  bool next_edge(Edge *edge) {
    if (at_ == loop_from_ + loop_edges_ && loop_ + 1 < loops_) {
      ++loop_;
      at_ = loop_from_;
    }
    if (at_ >= received_) return false;
    *edge = edges_[at_++];
    return true;
  }
  uint32_t begin_level() const { return begin_; }
  uint32_t end_us() const { return end_us_; }

  // The waveform is over: `answer` says so.
  void finish(uint32_t late_us) {
    playing = false;
    answer.clear();
    answer.text(number_of_play_.bytes()).text(" done ").number(played_edges()).text(" ").number(late_us).end();
    if (last_request_.equals(play_request_.bytes(), play_request_.length())) last_answer_ = answer;
  }
  void say_boot() {
    answer.clear();
    answer.text("! boot evs-led").end();
  }
  void say_watchdog() {
    level = 0;
    last_request_.clear();  // what was answered before is no longer true
    answer.clear();
    answer.text("! watchdog").end();
  }

 private:
  void start() {
    level = 0;
    playing = false;
    watchdog_ms = 0;
    forget();
  }
  void forget() {
    stored_ = false;
    begin_ = announced_ = received_ = loop_from_ = loop_edges_ = end_us_ = 0;
    loops_ = 1;
    at_ = loop_ = 0;
  }
  static bool is(const char *word, size_t length, const char *name) {
    return strlen(name) == length && memcmp(word, name, length) == 0;
  }
  static bool in_range(uint32_t value) { return value < (1UL << EVS_LED_DAC_BITS); }
  static bool can_be_timed(uint32_t us) { return us >= EVS_LED_SHORTEST_US && us <= kLongestUs; }

  uint64_t played_edges() const {
    return (uint64_t)received_ + (uint64_t)loop_edges_ * (loops_ - 1);
  }
  uint64_t duration_us() const {
    uint64_t sum = end_us_;
    for (uint32_t i = 0; i < received_; ++i) {
      const bool in_loop = i >= loop_from_ && i < loop_from_ + loop_edges_;
      sum += (uint64_t)edges_[i].delta_us * (in_loop ? loops_ : 1);
    }
    return sum;
  }

  Action obey(const char *command, size_t length) {
    Words words(command, length);
    const char *name;
    size_t name_length;
    words.next(&name, &name_length);
    answer.clear();
    answer.text(number_.bytes()).text(" ");
    uint32_t v[6];
    if (is(name, name_length, "hello")) return words.numbers(v, 0) ? hello() : refuse(3);
    if (is(name, name_length, "level?")) return words.numbers(v, 0) ? tell_level(kNothing) : refuse(3);
    if (is(name, name_length, "status")) return words.numbers(v, 0) ? status() : refuse(3);
    if (is(name, name_length, "dark")) return words.numbers(v, 0) ? stop(0) : refuse(3);
    if (is(name, name_length, "abort")) return words.numbers(v, 0) ? stop(level) : refuse(3);
    if (is(name, name_length, "watchdog")) return words.numbers(v, 1) ? set_watchdog(v[0]) : refuse(3);
    const bool level_set = is(name, name_length, "level"), wave = is(name, name_length, "wave");
    const bool square = is(name, name_length, "square"), play = is(name, name_length, "play");
    const bool edges = is(name, name_length, "edges");
    if (!level_set && !wave && !square && !play && !edges) return refuse(2);
    if (playing) return refuse(8);
    if (edges) return store_edges(words);
    if (!words.numbers(v, level_set ? 1 : play ? 2 : 6)) return refuse(3);
    if (level_set) return set_level(v[0]);
    if (play) return start_play(v[0], v[1]);
    return wave ? store_wave(v) : store_square(v);
  }

  Action refuse(int code) {
    static const char *const kTexts[] = {"", "garbled", "unknown command", "bad argument", "out of range",
        "too many edges", "no whole waveform", "not the waveform that is stored", "playing"};
    answer.text("error ").number((uint64_t)code).text(" ").text(kTexts[code]);
    return kNothing;
  }
  Action hello() {
    answer.text("ok evs-led protocol=1 firmware=1.0 serial=").text(serial_);
    answer.text(" tick_us=").number(EVS_LED_TICK_US).text(" dac_bits=").number(EVS_LED_DAC_BITS);
    answer.text(" max_edges=").number(EVS_LED_MAX_EDGES).text(" shortest_us=").number(EVS_LED_SHORTEST_US);
    return kNothing;
  }
  Action tell_level(Action action) {
    answer.text("ok ").number(level);
    return action;
  }
  Action status() {
    answer.text("ok level=").number(level).text(" playing=").number(playing ? 1 : 0);
    answer.text(" stored=").number(received_).text(" watchdog_ms=").number(watchdog_ms);
    return kNothing;
  }
  Action stop(uint32_t to_level) {
    playing = false;
    level = to_level;
    return tell_level(kSetLevel);
  }
  Action set_watchdog(uint32_t ms) {
    watchdog_ms = ms;
    answer.text("ok");
    return kNothing;
  }
  Action set_level(uint32_t to_level) {
    if (!in_range(to_level)) return refuse(4);
    level = to_level;
    return tell_level(kSetLevel);
  }
  Action store_wave(const uint32_t *v) {
    forget();
    if (!in_range(v[0])) return refuse(4);
    if (v[1] > EVS_LED_MAX_EDGES) return refuse(5);
    const bool loop_fits = (uint64_t)v[2] + v[3] <= v[1] && v[4] >= 1 && (v[3] >= 1 || v[4] == 1);
    if (!loop_fits || v[5] > kLongestUs) return refuse(4);
    begin_ = v[0]; announced_ = v[1]; loop_from_ = v[2]; loop_edges_ = v[3]; loops_ = v[4]; end_us_ = v[5];
    stored_ = true;
    answer.text("ok 0");
    return kNothing;
  }
  Action store_edges(Words words) {
    uint32_t first;
    Edge fresh[kMostPairs];
    bool fits = true;
    size_t count = 0;
    const char *word;
    size_t length;
    if (!words.next(&word, &length) || !Words::number(word, length, &first)) return refuse(3);
    while (words.next(&word, &length)) {
      const char *colon = (const char *)memchr(word, ':', length);
      uint32_t delta_us, to_level;
      if (!colon || count == kMostPairs || !Words::number(word, (size_t)(colon - word), &delta_us) ||
          !Words::number(colon + 1, length - (size_t)(colon - word) - 1, &to_level)) {
        return refuse(3);
      }
      fits = fits && can_be_timed(delta_us) && in_range(to_level);
      fresh[count].delta_us = delta_us;
      fresh[count++].level = (uint16_t)to_level;
    }
    if (!count) return refuse(3);
    if (!stored_ || first != received_) return refuse(6);
    if (received_ + count > announced_) return refuse(5);
    if (!fits) return refuse(4);
    for (size_t i = 0; i < count; ++i) edges_[received_++] = fresh[i];
    answer.text("ok ").number(received_);
    return kNothing;
  }
  Action store_square(const uint32_t *v) {
    forget();
    const uint32_t low = v[0], high = v[1], period_us = v[2], bright_us = v[3], count = v[4], preamble_us = v[5];
    if (!in_range(low) || !in_range(high)) return refuse(4);
    if (count < 1 || bright_us > period_us || !can_be_timed(bright_us) || !can_be_timed(period_us - bright_us) ||
        !can_be_timed(preamble_us)) {
      return refuse(4);
    }
    const Edge edges[4] = {{preamble_us, (uint16_t)high}, {bright_us, (uint16_t)low},
        {period_us - bright_us, (uint16_t)high}, {bright_us, (uint16_t)low}};
    begin_ = low;
    end_us_ = period_us - bright_us;
    announced_ = received_ = count == 1 ? 2 : 4;
    loop_from_ = count == 1 ? 0 : 1;
    loop_edges_ = 2;
    loops_ = count == 1 ? 1 : count - 1;
    for (uint32_t i = 0; i < received_; ++i) edges_[i] = edges[i];
    stored_ = true;
    answer.text("ok ").number(received_);
    return kNothing;
  }
  Action start_play(uint32_t edges, uint32_t for_us) {
    if (!stored_ || received_ != announced_) return refuse(6);
    if (played_edges() != edges || duration_us() != for_us) return refuse(7);
    at_ = loop_ = 0;
    playing = true;
    level = begin_;
    number_of_play_ = number_;
    play_request_ = last_request_;
    answer.text("ok");
    return kPlay;
  }

  const char *serial_;
  Edge edges_[EVS_LED_MAX_EDGES];
  bool stored_;
  uint32_t begin_, announced_, received_, loop_from_, loop_edges_, loops_, end_us_;
  uint32_t at_, loop_;
  Line last_request_, last_answer_, number_, number_of_play_, play_request_;
};

}  // namespace evs_led

#endif  // EVS_LED_PROTOCOL_H
