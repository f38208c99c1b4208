// MCAP writing through the official Rust crate. One thread at a time a writer; strings are UTF-8 and end in zero.
#ifndef CRUX_MCAP_C_H
#define CRUX_MCAP_C_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct McapWriter McapWriter;

// Creates the file (LZ4 chunks of about chunk_bytes). NULL when it cannot, with the reason in `error`.
McapWriter *mcap_c_open(const char *path, const char *profile, const char *library, uint64_t chunk_bytes, char *error,
                        size_t error_size);

// These two return an identifier 0..65535, the others 0; all return -1 when they fail (mcap_c_error tells why).
int32_t mcap_c_add_schema(McapWriter *writer, const char *name, const char *encoding, const uint8_t *data, size_t n);
int32_t mcap_c_add_channel(McapWriter *writer, uint16_t schema, const char *topic, const char *encoding);

// Log time and publish time are the same.
int32_t mcap_c_write(McapWriter *writer, uint16_t channel, uint32_t sequence, uint64_t log_time_ns, const uint8_t *data,
                     size_t n);
int32_t mcap_c_write_metadata(McapWriter *writer, const char *name, const char *const *keys, const char *const *values,
                              size_t n);
int32_t mcap_c_attach(McapWriter *writer, const char *name, const char *media_type, const uint8_t *data, size_t n);

// Ends the chunk and puts everything into the file, which stays whole throughout: from here on the data outlives the
// program, from the next flush on a power cut as well. Writes no more than what is new.
int32_t mcap_c_flush(McapWriter *writer);

// What went wrong last.
void mcap_c_error(const McapWriter *writer, char *error, size_t error_size);

// Flushes, writes the summary and frees the writer, also when it fails.
int32_t mcap_c_close(McapWriter *writer, char *error, size_t error_size);

#ifdef __cplusplus
}
#endif

#endif
