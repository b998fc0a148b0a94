#!/usr/bin/env python3
"""The translator of PTX refuses, by name, what would not give the CPU's answers."""
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).parent
HEAD = ".version 9.0\n.target {}\n.address_size 64\n"
KERNEL = """.visible .entry kernel(
	.param .align 8 .b8 kernel_param_0[16]
)
.maxntid 32, 1, 1
{{
	.reg .pred %p<9>;
	.reg .b32 %r<9>;
	.reg .f32 %f<9>;
	.reg .f64 %fd<9>;
	.reg .b64 %rd<9>;
{}
	ret;
}}
"""


def translate(*texts):
    """The generated C++ of PTX files."""
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for n, text in enumerate(texts):
            paths.append(f"{folder}/{n}.ptx")
            pathlib.Path(paths[-1]).write_text(text, encoding="utf-8")
        out = f"{folder}/out.cpp"
        subprocess.run([sys.executable, HERE / "ptx_to_cpp.py", out, *paths], check=True)
        return pathlib.Path(out).read_text(encoding="utf-8")


def counting(text):
    """The generated C++ that counts."""
    with tempfile.TemporaryDirectory() as folder:
        path, out = f"{folder}/in.ptx", f"{folder}/out.cpp"
        pathlib.Path(path).write_text(text, encoding="utf-8")
        subprocess.run([sys.executable, HERE / "ptx_to_cpp.py", "--count", out, path], check=True)
        return pathlib.Path(out).read_text(encoding="utf-8")


def refusals(body):
    code = translate(HEAD.format("sm_90") + KERNEL.format(body))
    return re.findall(r'^    "(sm_90: .*)",$', code, re.M)


class PtxToCpp(unittest.TestCase):
    def test_keeps_local_memory(self):
        code = translate(HEAD.format("sm_90") + KERNEL.format("""
	.local .align 8 .b8 	__local_depot0[24];
	.loc 1 2 3
	mov.u64 %rd1, __local_depot0;
	st.local.u32 [%rd1+4], %r1;"""))
        self.assertIn("unsigned char local[24]", code)
        self.assertNotIn("refused", code)

    def test_counts_blocks_and_touches_of_global_memory(self):
        code = counting(HEAD.format("sm_90") + KERNEL.format("""
	ld.param.u64 %rd1, [kernel_param_0];
	ld.global.u32 %r1, [%rd1];
	setp.eq.s32 %p1, %r1, 0;
	@%p1 bra $L1;
	st.global.u32 [%rd1+64], %r1;
	vote.sync.ballot.b32 %r2, %p1, -1;
	add.s32 %r1, %r1, 1;
$L1:
	add.s32 %r1, %r1, 2;"""))
        self.assertIn("k_sizes_kernel[] = {4u, 2u, 1u, 2u}", code)
        self.assertIn('{"sm_90", "kernel", 9, launch_kernel}', code)
        self.assertEqual(code.count("s.touch("), 2)
        self.assertEqual(code.count("++s.runs["), 4)

    def test_refuses_by_name(self):
        for instruction, why in [
                ("fma.rn.f32 %f1, %f2, %f3, %f4", "a fused multiply-add"),
                ("mad.rn.f32 %f1, %f2, %f3, %f4", "a fused multiply-add"),
                ("add.f32 %f1, %f2, %f3", "not rounded to nearest, or free to be contracted"),
                ("mul.rz.f32 %f1, %f2, %f3", "not rounded to nearest, or free to be contracted"),
                ("mul.rn.sat.f32 %f1, %f2, %f3", "not rounded to nearest, or free to be contracted"),
                ("add.rn.ftz.f32 %f1, %f2, %f3", "flushes to zero"),
                ("setp.lt.ftz.f32 %p1, %f2, %f3", "flushes to zero"),
                ("div.full.f32 %f1, %f2, %f3", "approximate"),
                ("rcp.approx.f32 %f1, %f2", "approximate"),
                ("sqrt.approx.f32 %f1, %f2", "approximate"),
                ("ex2.approx.f32 %f1, %f2", "approximate"),
                ("add.sat.s32 %r1, %r2, %r3", "unknown"),
                ("atom.global.add.u32 %r1, [%rd1], %r2", "unknown"),
                ("ld.volatile.global.u32 %r1, [%rd1]", "unknown"),
                ("cvt.rn.f32.f64 %f1, %r9000", "unknown register %r9000"),
                ("call.uni somewhere", "unknown"),
                ("no.such.opcode %r1, %r2", "unknown")]:
            opcode = instruction.split()[0]
            self.assertEqual(refusals(f"\t{instruction};"), [f"sm_90: kernel: {opcode}: {why}"])

    def test_takes_exact_instructions(self):
        for instruction in ["add.rn.f32 %f1, %f2, 0f3F800000", "div.rn.f64 %fd1, %fd2, %fd3", "mad.lo.s32 %r1, %r2, 3, %r4",
                            "mad.wide.u32 %rd1, %r2, 4, %rd3", "@!%p1 mov.u32 %r1, %tid.x", "@%p1 bra $L1;\n$L1:",
                            "setp.gtu.f32 %p1, %f1, 0f80000000", "cvt.rzi.s32.f32 %r1, %f2", "mov.b64 {%r1, %r2}, %rd1",
                            "{ .reg .b32 tmp; mov.b64 {tmp, %r1}, %rd1; }\n\tmov.u32 %r2, 1",
                            "ld.global.nc.v2.f32 {%f1, %f2}, [%rd1+-8]", "shf.l.wrap.b32 %r1, %r2, %r3, 7",
                            "vote.sync.ballot.b32 %r1, %p2, -1", "shfl.sync.bfly.b32 %r1|%p1, %r2, 16, 31, -1"]:
            self.assertEqual(refusals(f"\t{instruction};"), [], instruction)

    def test_refuses_what_stands_outside_of_kernels(self):
        code = translate(HEAD.format("sm_90") + ".global .align 4 .b8 table[16];\n" + KERNEL.format(""))
        self.assertIn("sm_90: outside of kernels: .global .align 4 .b8 table[16];", code)

    def test_keeps_what_is_read_after_an_exchange(self):
        code = translate(HEAD.format("sm_90") + KERNEL.format(
            "\tmov.u32 %r1, 1;\n\tmov.u32 %r2, 2;\n\tmov.u32 %r3, 3;\n\tvote.sync.ballot.b32 %r3, %p2, -1;\n"
            "\tadd.s32 %r4, %r1, %r3;"))
        self.assertEqual(re.findall(r"^  uint32_t kept_(\w+);", code, re.M), ["r1"])

    def test_architectures_share_what_is_the_same(self):
        one, other = KERNEL.format("\tmov.u32 %r1, 1;"), KERNEL.format("\tmov.u32 %r1, 2;")
        code = translate(HEAD.format("sm_75") + one, HEAD.format("sm_80") + one, HEAD.format("sm_90") + other)
        self.assertEqual(re.findall(r'\{(\d), "(\w+)", "kernel", 16', code),
                         [("0", "sm_75_sm_80"), ("1", "sm_90")])


if __name__ == "__main__":
    unittest.main()
