// The convolutions of 16 pixels over a stretch of ticks, in registers.
//
// Order of every sum, for all instruction sets, chunks and blockings: start from the bias, inputs
// one after another, in each its taps from the oldest on, one std::fma a term. So an output does
// not depend on what is computed beside it.
//
// Included by kernel.inl inside a namespace of its own.

// One register of lanes: with more of them in one variable, compilers keep sums in memory.
#if EVS_WIDTH == 512
using Wide = __m512;
EVS_INLINE Wide wide(float a) { return _mm512_set1_ps(a); }
EVS_INLINE Wide wide_fma(Wide a, Wide b, Wide c) { return _mm512_fmadd_ps(a, b, c); }
// from 0 to the largest float: never -0, NaN or Inf
EVS_INLINE Wide wide_relu(Wide a) {
  return _mm512_min_ps(_mm512_max_ps(a, wide(0.0f)), wide(kLargest));
}
// outputs times ticks that are summed side by side; with less ticks left, outputs alone
constexpr int OUTPUTS = 4, TICKS = 4, OUTPUTS_ALONE = 8;
#else
using Wide = FloatPart;
constexpr int OUTPUTS = 4, TICKS = 2, OUTPUTS_ALONE = 8;
EVS_INLINE Wide wide(float a) { return a - Wide{}; }
#if EVS_WIDTH == 256
EVS_INLINE Wide wide_fma(Wide a, Wide b, Wide c) { return _mm256_fmadd_ps(a, b, c); }
#else
// slow where the compiler knows no such instruction: a call for each lane
EVS_INLINE Wide wide_fma(Wide a, Wide b, Wide c) {
#pragma GCC unroll 4
  for (int i = 0; i < PART; i++) c[i] = __builtin_fmaf(a[i], b[i], c[i]);
  return c;
}
#endif
EVS_INLINE Wide wide_relu(Wide a) {
  a = a > wide(0.0f) ? a : wide(0.0f);
  return a < wide(kLargest) ? a : wide(kLargest);
}
#endif

constexpr int WIDE = EVS_WIDTH / 32;  // lanes of it

EVS_INLINE Wide wide_load(const float* p) {
  Wide a;
  __builtin_memcpy(&a, p, sizeof a);
  return a;
}
EVS_INLINE void wide_store(float* p, Wide a) { __builtin_memcpy(p, &a, sizeof a); }

constexpr int SLOT = kLanes;
constexpr int FEATURE = kSlots * kLanes;

// What the next pixels remember comes nearer, piece by piece while others are computed: all at once
// would wait for each other.
struct Fetching {
  const PixelJob& job;
  int pixel = 0;
  int at = 0;

  EVS_INLINE void lines(int count) {
    const int floats = job.net->pixel_floats();
    for (int i = 0; i < count && pixel < LANES; i++) {
      __builtin_prefetch(job.next_row[pixel] + at, 1, 2);
      at += SLOT;
      if (at >= floats) at = 0, pixel++;
    }
  }
  EVS_INLINE void rest() { lines(LANES * job.net->pixel_floats()); }
};

struct Convolving {
  const float* weights;  // (out, in, 7)
  const float* biases;   // (out,)
  int outputs;
  int inputs;
  const float* in;    // [in][22][16]; tap 0 of the first tick is in slot 0
  float* out;         // [out][22][16], from slot 6 on
  const float* held;  // [out][22][16] at the slot of the first tick; null: nothing is added
  int ticks;
};

// N outputs from `o` on, T ticks from `t` on, a register of lanes. INPUTS: how many, 0 where only
// the network knows.
template <int INPUTS, int N, int T>
EVS_INLINE void patch(const Convolving& c, int o, int t, int lane) {
  const int inputs = INPUTS > 0 ? INPUTS : c.inputs;
  const int line = inputs * kTaps;
  const float* weights = c.weights + o * line;
  const float* in = c.in + t * SLOT + lane;
  Wide sum[N][T];
#pragma GCC unroll 8
  for (int n = 0; n < N; n++) {
#pragma GCC unroll 8
    for (int k = 0; k < T; k++) sum[n][k] = wide(c.biases[o + n]);
  }
  for (int i = 0; i < inputs; i++) {
#pragma GCC unroll 8
    for (int j = 0; j < kTaps; j++) {
      Wide x[T];
#pragma GCC unroll 8
      for (int k = 0; k < T; k++) x[k] = wide_load(in + (j + k) * SLOT);
#pragma GCC unroll 8
      for (int n = 0; n < N; n++) {
        const Wide weight = wide(weights[n * line + j]);
#pragma GCC unroll 8
        for (int k = 0; k < T; k++) sum[n][k] = wide_fma(weight, x[k], sum[n][k]);
      }
    }
    weights += kTaps;
    in += FEATURE;
  }
#pragma GCC unroll 8
  for (int n = 0; n < N; n++) {
    float* out = c.out + (o + n) * FEATURE + (kOld + t) * SLOT + lane;
#pragma GCC unroll 8
    for (int k = 0; k < T; k++) {
      Wide value = sum[n][k];
      if (c.held != nullptr) {
        value = wide_load(c.held + (o + n) * FEATURE + (t + k) * SLOT + lane) + value;
      }
      wide_store(out + k * SLOT, wide_relu(value));
    }
  }
}

template <int INPUTS, int N, int T>
EVS_INLINE void all_lanes(const Convolving& c, int o, int t, Fetching& fetching) {
  fetching.lines(16);
  for (int lane = 0; lane < LANES; lane += WIDE) patch<INPUTS, N, T>(c, o, t, lane);
}

template <int INPUTS, int N>
EVS_INLINE void stripe(const Convolving& c, int o, Fetching& fetching) {
  int t = 0;
  for (; t + TICKS <= c.ticks; t += TICKS) all_lanes<INPUTS, N, TICKS>(c, o, t, fetching);
  for (; t < c.ticks; t++) all_lanes<INPUTS, N, 1>(c, o, t, fetching);
}

template <int INPUTS>
[[gnu::noinline]] void convolve(const Convolving& c, Fetching& fetching) {
  int o = 0;
  if (c.ticks < TICKS) {
    for (; o + OUTPUTS_ALONE <= c.outputs; o += OUTPUTS_ALONE) {
      for (int t = 0; t < c.ticks; t++) all_lanes<INPUTS, OUTPUTS_ALONE, 1>(c, o, t, fetching);
    }
  }
  for (; o + OUTPUTS <= c.outputs; o += OUTPUTS) stripe<INPUTS, OUTPUTS>(c, o, fetching);
  for (; o < c.outputs; o++) stripe<INPUTS, 1>(c, o, fetching);
}

EVS_INLINE void convolve(const Convolving& c, Fetching& fetching) {
  if (c.inputs == 1) return convolve<1>(c, fetching);
  if (c.inputs == 4) return convolve<4>(c, fetching);
  if (c.inputs == 8) return convolve<8>(c, fetching);
  convolve<0>(c, fetching);
}
