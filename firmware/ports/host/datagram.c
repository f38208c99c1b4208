#include "datagram.h"

#include <string.h>

enum { NIL = 0xC0, FALSE = 0xC2, TRUE = 0xC3, BIN8 = 0xC4, FLOAT64 = 0xCB };
enum {
  UINT8 = 0xCC,
  UINT16 = 0xCD,
  UINT32 = 0xCE,
  UINT64 = 0xCF,
  INT8 = 0xD0,
  INT64 = 0xD3,
  STR8 = 0xD9,
  MAP16 = 0xDE
};

typedef struct writer {
  uint8_t *at;
} writer;

static void put_bytes(writer *out, const void *bytes, size_t length) {
  (void)memcpy(out->at, bytes, length);
  out->at += length;
}

static void put(writer *out, uint8_t byte) { *out->at++ = byte; }

static void put_key(writer *out, const char *key) {
  const size_t length = strlen(key);
  put(out, (uint8_t)(0xA0U | length));
  put_bytes(out, key, length);
}

static void put_flag(writer *out, const char *key, bool value) {
  put_key(out, key);
  put(out, value ? TRUE : FALSE);
}

size_t crux_datagram_encode(const crux_frame *frame, uint8_t datagram[CRUX_DATAGRAM_CAPACITY]) {
  static const uint8_t no_time[8] = {0};
  writer out = {datagram};
  put(&out, 0x80U | 11U);
  // Receivers stamp arrivals themselves; a sender's clock would make runs differ.
  put_key(&out, "timestamp");
  put(&out, FLOAT64);
  put_bytes(&out, no_time, sizeof(no_time));
  put_key(&out, "arbitration_id");
  put(&out, UINT16);
  put(&out, (uint8_t)(frame->id >> 8U));
  put(&out, (uint8_t)(frame->id & 0xFFU));
  put_flag(&out, "is_extended_id", false);
  put_flag(&out, "is_remote_frame", false);
  put_flag(&out, "is_error_frame", false);
  put_key(&out, "channel");
  put(&out, NIL);
  put_key(&out, "dlc");
  put(&out, frame->length);
  put_key(&out, "data");
  put(&out, BIN8);
  put(&out, frame->length);
  put_bytes(&out, frame->data, frame->length);
  put_flag(&out, "is_fd", true);
  put_flag(&out, "bitrate_switch", true);
  put_flag(&out, "error_state_indicator", false);
  return (size_t)(out.at - datagram);
}

typedef struct reader {
  const uint8_t *at;
  const uint8_t *end;
} reader;

/// One msgpack value: a number (also booleans; nil and floats count as 0) or a run of bytes.
typedef struct value {
  uint64_t number;
  const uint8_t *bytes;
  size_t length;
} value;

static bool skip(reader *in, size_t length, const uint8_t **start) {
  const bool fits = (size_t)(in->end - in->at) >= length;
  if (fits) {
    *start = in->at;
    in->at += length;
  }
  return fits;
}

static bool big_endian(reader *in, size_t length, uint64_t *number) {
  const uint8_t *start = NULL;
  const bool fits = skip(in, length, &start);
  *number = 0U;
  for (size_t i = 0U; fits && (i < length); i++) {
    *number = (*number << 8U) | start[i];
  }
  return fits;
}

static bool run_of_bytes(reader *in, size_t length, value *result) {
  result->length = length;
  return skip(in, length, &result->bytes);
}

static bool get_value(reader *in, value *result) {
  const uint8_t *start = NULL;
  uint64_t length = 0U;
  *result = (value){0};
  if (!skip(in, 1U, &start)) {
    return false;
  }
  const uint8_t tag = *start;
  if (tag < 0x80U) {
    result->number = tag;
    return true;
  }
  if ((tag & 0xE0U) == 0xA0U) {
    return run_of_bytes(in, tag & 0x1FU, result);
  }
  if ((tag == BIN8) || (tag == STR8)) {
    return big_endian(in, 1U, &length) && run_of_bytes(in, (size_t)length, result);
  }
  if ((tag >= UINT8) && (tag <= UINT64)) {
    return big_endian(in, (size_t)1U << (tag - UINT8), &result->number);
  }
  if ((tag >= INT8) && (tag <= INT64)) {
    return skip(in, (size_t)1U << (tag - INT8), &start);
  }
  if (tag == FLOAT64) {
    return skip(in, 8U, &start);
  }
  result->number = (tag == TRUE) ? 1U : 0U;
  return (tag == TRUE) || (tag == FALSE) || (tag == NIL) || (tag >= 0xE0U);
}

static bool is_key(const value *key, const char *name) {
  return (key->bytes != NULL) && (key->length == strlen(name)) && (memcmp(key->bytes, name, key->length) == 0);
}

static bool get_count(reader *in, uint64_t *count) {
  const uint8_t *start = NULL;
  bool found = skip(in, 1U, &start);
  if (found && ((*start & 0xF0U) == 0x80U)) {
    *count = *start & 0x0FU;
  } else {
    found = found && (*start == MAP16) && big_endian(in, 2U, count);
  }
  return found;
}

bool crux_datagram_decode(const uint8_t *datagram, size_t length, crux_frame *frame) {
  reader in = {datagram, datagram + length};
  uint64_t count = 0U;
  uint64_t id = UINT64_MAX;
  bool has_data = false;
  bool foreign = false;
  if (!get_count(&in, &count)) {
    return false;
  }
  for (uint64_t i = 0U; i < count; i++) {
    value key;
    value content;
    if (!get_value(&in, &key) || !get_value(&in, &content)) {
      return false;
    }
    if (is_key(&key, "arbitration_id")) {
      id = content.number;
    } else if (is_key(&key, "data")) {
      has_data = (content.bytes != NULL) && (content.length <= CRUX_FRAME_CAPACITY);
      if (has_data) {
        frame->length = (uint8_t)content.length;
        (void)memcpy(frame->data, content.bytes, content.length);
      }
    } else if (is_key(&key, "is_extended_id") || is_key(&key, "is_remote_frame") || is_key(&key, "is_error_frame")) {
      foreign = foreign || (content.number != 0U);
    } else {
      // nothing the nodes need
    }
  }
  frame->id = (uint16_t)id;
  return has_data && !foreign && (id < 0x800U);
}
