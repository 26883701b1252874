module lower_case
  pers tooldata tgun:=[true,[[50,-30,250],[0.9437143641,0.1276794407,-0.1448781254,0.2685358228]],[12,[0,0,100],[1,0,0,0],0,0,0]];
  pers wobjdata wpart:=[false,true,"",[[900,-400,120],[0.9380860126,0.0499192929,0.0096612762,-0.3426504879]],[[0,0,0],[1,0,0,0]]];
  const robtarget P1:=[[461.921,1581.755,1001.355],[0.75767605,0.11931039,0.45452722,0.45287640],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  ! Höhe: MoveL p1,v100,fine,tgun;
  proc main()
    tpwrite "MoveL p1,v100,fine,tgun; ""so""";
    movel p1,v100,fine,tgun\wobj:=wpart;
    MOVEJ p1,V100,FINE,TGUN\WOBJ:=WPART;
  endproc
endmodule
