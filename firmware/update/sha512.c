#include "sha512.h"

#include <string.h>

#define BLOCK 128U
#define LENGTH_AT 112U  ///< of the message in bits: sixteen bytes at the end of the last block

/// First 64 bits of the fractional parts of the cube roots of the first eighty primes.
static const uint64_t ROUNDS[80] = {
    0x428A2F98D728AE22U, 0x7137449123EF65CDU, 0xB5C0FBCFEC4D3B2FU, 0xE9B5DBA58189DBBCU, 0x3956C25BF348B538U,
    0x59F111F1B605D019U, 0x923F82A4AF194F9BU, 0xAB1C5ED5DA6D8118U, 0xD807AA98A3030242U, 0x12835B0145706FBEU,
    0x243185BE4EE4B28CU, 0x550C7DC3D5FFB4E2U, 0x72BE5D74F27B896FU, 0x80DEB1FE3B1696B1U, 0x9BDC06A725C71235U,
    0xC19BF174CF692694U, 0xE49B69C19EF14AD2U, 0xEFBE4786384F25E3U, 0x0FC19DC68B8CD5B5U, 0x240CA1CC77AC9C65U,
    0x2DE92C6F592B0275U, 0x4A7484AA6EA6E483U, 0x5CB0A9DCBD41FBD4U, 0x76F988DA831153B5U, 0x983E5152EE66DFABU,
    0xA831C66D2DB43210U, 0xB00327C898FB213FU, 0xBF597FC7BEEF0EE4U, 0xC6E00BF33DA88FC2U, 0xD5A79147930AA725U,
    0x06CA6351E003826FU, 0x142929670A0E6E70U, 0x27B70A8546D22FFCU, 0x2E1B21385C26C926U, 0x4D2C6DFC5AC42AEDU,
    0x53380D139D95B3DFU, 0x650A73548BAF63DEU, 0x766A0ABB3C77B2A8U, 0x81C2C92E47EDAEE6U, 0x92722C851482353BU,
    0xA2BFE8A14CF10364U, 0xA81A664BBC423001U, 0xC24B8B70D0F89791U, 0xC76C51A30654BE30U, 0xD192E819D6EF5218U,
    0xD69906245565A910U, 0xF40E35855771202AU, 0x106AA07032BBD1B8U, 0x19A4C116B8D2D0C8U, 0x1E376C085141AB53U,
    0x2748774CDF8EEB99U, 0x34B0BCB5E19B48A8U, 0x391C0CB3C5C95A63U, 0x4ED8AA4AE3418ACBU, 0x5B9CCA4F7763E373U,
    0x682E6FF3D6B2B8A3U, 0x748F82EE5DEFB2FCU, 0x78A5636F43172F60U, 0x84C87814A1F0AB72U, 0x8CC702081A6439ECU,
    0x90BEFFFA23631E28U, 0xA4506CEBDE82BDE9U, 0xBEF9A3F7B2C67915U, 0xC67178F2E372532BU, 0xCA273ECEEA26619CU,
    0xD186B8C721C0C207U, 0xEADA7DD6CDE0EB1EU, 0xF57D4F7FEE6ED178U, 0x06F067AA72176FBAU, 0x0A637DC5A2C898A6U,
    0x113F9804BEF90DAEU, 0x1B710B35131C471BU, 0x28DB77F523047D84U, 0x32CAAB7B40C72493U, 0x3C9EBE0A15C9BEBCU,
    0x431D67C49C100D4CU, 0x4CC5D4BECB3E42B6U, 0x597F299CFC657E2AU, 0x5FCB6FAB3AD6FAECU, 0x6C44198C4A475817U,
};

/// As above, of the square roots of the first eight.
static const uint64_t START[8] = {
    0x6A09E667F3BCC908U, 0xBB67AE8584CAA73BU, 0x3C6EF372FE94F82BU, 0xA54FF53A5F1D36F1U,
    0x510E527FADE682D1U, 0x9B05688C2B3E6C1FU, 0x1F83D9ABFB41BD6BU, 0x5BE0CD19137E2179U,
};

static uint64_t rotate(uint64_t x, uint32_t by) { return (x >> by) | (x << (64U - by)); }

static uint64_t small_0(uint64_t x) { return rotate(x, 1U) ^ rotate(x, 8U) ^ (x >> 7U); }

static uint64_t small_1(uint64_t x) { return rotate(x, 19U) ^ rotate(x, 61U) ^ (x >> 6U); }

static uint64_t big_0(uint64_t x) { return rotate(x, 28U) ^ rotate(x, 34U) ^ rotate(x, 39U); }

static uint64_t big_1(uint64_t x) { return rotate(x, 14U) ^ rotate(x, 18U) ^ rotate(x, 41U); }

static void mix(crux_sha512 *sha) {
  uint64_t w[16];
  uint64_t v[8];
  (void)memcpy(v, sha->state, sizeof(v));
  for (uint32_t i = 0U; i < 16U; i++) {
    w[i] = 0U;
    for (uint32_t j = 0U; j < 8U; j++) {
      w[i] = (w[i] << 8U) | sha->block[(8U * i) + j];
    }
  }
  for (uint32_t i = 0U; i < 80U; i++) {
    uint64_t *word = &w[i % 16U];  // the last sixteen words of the schedule, in a ring
    if (i >= 16U) {
      *word += small_1(w[(i + 14U) % 16U]) + w[(i + 9U) % 16U] + small_0(w[(i + 1U) % 16U]);
    }
    const uint64_t chosen = (v[4] & v[5]) ^ (~v[4] & v[6]);
    const uint64_t majority = (v[0] & v[1]) ^ (v[0] & v[2]) ^ (v[1] & v[2]);
    const uint64_t first = v[7] + big_1(v[4]) + chosen + ROUNDS[i] + *word;
    (void)memmove(&v[1], &v[0], 7U * sizeof(v[0]));
    v[4] += first;
    v[0] = first + big_0(v[1]) + majority;
  }
  for (uint32_t i = 0U; i < 8U; i++) {
    sha->state[i] += v[i];
  }
}

void crux_sha512_init(crux_sha512 *sha) {
  *sha = (crux_sha512){0};
  (void)memcpy(sha->state, START, sizeof(START));
}

void crux_sha512_add(crux_sha512 *sha, const uint8_t *bytes, size_t length) {
  size_t done = 0U;
  while (done < length) {
    const size_t filled = (size_t)(sha->length % BLOCK);
    const size_t room = BLOCK - filled;
    const size_t taken = ((length - done) < room) ? (length - done) : room;
    (void)memcpy(&sha->block[filled], &bytes[done], taken);
    sha->length += taken;
    done += taken;
    if ((sha->length % BLOCK) == 0U) {
      mix(sha);
    }
  }
}

void crux_sha512_end(crux_sha512 *sha, uint8_t digest[CRUX_SHA512_LENGTH]) {
  static const uint8_t ONE = 0x80U;
  static const uint8_t ZERO = 0U;
  const uint64_t bits = sha->length * 8U;
  uint8_t tail[16] = {0};
  crux_sha512_add(sha, &ONE, 1U);
  while ((sha->length % BLOCK) != LENGTH_AT) {
    crux_sha512_add(sha, &ZERO, 1U);
  }
  for (uint32_t i = 0U; i < 8U; i++) {
    tail[8U + i] = (uint8_t)(bits >> (56U - (8U * i)));
  }
  crux_sha512_add(sha, tail, sizeof(tail));
  for (uint32_t i = 0U; i < CRUX_SHA512_LENGTH; i++) {
    digest[i] = (uint8_t)(sha->state[i / 8U] >> (56U - (8U * (i % 8U))));
  }
}
