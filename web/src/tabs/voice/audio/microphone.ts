/** The microphone: frames of 50 ms of mono PCM at 16 kHz. */
import { TextError } from "@/i18n/text_error";
// oxlint-disable-next-line import/default -- Vite builds the script, and exports its address
import workletUrl from "./capture_worklet.ts?worker&url";

/** Whether this page may ask for a microphone: browsers allow it to secure pages only. */
export function offersMicrophone(): boolean {
  return window.isSecureContext && navigator.mediaDevices !== undefined;
}

export class Microphone {
  private constructor(
    private readonly stream: MediaStream,
    private readonly source: MediaStreamAudioSourceNode,
    private readonly node: AudioWorkletNode,
  ) {}

  /** Ask for the microphone, and call `take` with each frame; `ended` if it is unplugged or withdrawn. Throws TextError. */
  static async open(context: AudioContext, take: (frame: Int16Array) => void, ended: () => void): Promise<Microphone> {
    let stream: MediaStream;
    try {
      // The robot's own voice comes back by the loudspeaker.
      stream = await navigator.mediaDevices.getUserMedia({ audio: { channelCount: 1, echoCancellation: true, noiseSuppression: true, autoGainControl: true } });
    } catch (error) {
      throw new TextError(error instanceof DOMException && error.name === "NotAllowedError" ? "voice_microphone_denied" : "voice_microphone_failed");
    }
    await context.audioWorklet.addModule(workletUrl);
    const source = context.createMediaStreamSource(stream);
    const node = new AudioWorkletNode(context, "capture", { numberOfInputs: 1, numberOfOutputs: 0, channelCount: 1, channelCountMode: "explicit" });
    node.port.onmessage = ({ data }: MessageEvent<Int16Array>) => take(data);
    stream.getAudioTracks()[0]?.addEventListener("ended", ended);
    source.connect(node);
    return new Microphone(stream, source, node);
  }

  close(): void {
    this.source.disconnect();
    this.node.port.onmessage = null;
    this.node.port.close();
    for (const track of this.stream.getTracks()) track.stop();
  }
}
